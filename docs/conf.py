"""Sphinx's settings: `sphinx-build -W docs docs/_build/html` makes the pages of this folder."""

from __future__ import annotations

import os
import sys
from pathlib import Path

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE / '_ext'))

import barc_sim  # noqa: E402

project = 'barc_sim'
author = 'barc_sim developers'
copyright = author  # noqa: A001 (Sphinx's name)
version = barc_sim.__version__
release = version

extensions = [
    'myst_nb',
    'sphinx.ext.autodoc',
    'sphinx.ext.napoleon',
    'sphinx.ext.viewcode',
    'sphinx_copybutton',
    'reference',
    'mathml',
]
exclude_patterns = ['_build', '_ext', '_figures']
default_role = 'code'

myst_enable_extensions = ['amsmath', 'attrs_block', 'colon_fence', 'deflist', 'dollarmath']
myst_heading_anchors = 3
math_eqref_format = '({number})'

# The notebooks are kept without outputs: a build runs them, and an error in one ends it.
nb_execution_mode = 'cache'
nb_execution_raise_on_error = True
nb_execution_timeout = 120
nb_merge_streams = True
os.environ.setdefault('ROS_DOMAIN_ID', '86')

autodoc_member_order = 'bysource'
autodoc_typehints = 'signature'
autodoc_default_options = {'members': True, 'ignore-module-all': True, 'exclude-members': 'set'}
napoleon_google_docstring = False
napoleon_use_rtype = False
python_use_unqualified_type_names = True
toc_object_entries = False
# Types are named without their modules, and a few names occur twice.
suppress_warnings = ['ref.python']

copybutton_prompt_text = r'\$ |>>> |\.\.\. '
copybutton_prompt_is_regexp = True
copybutton_only_copy_prompt_lines = True

# The test of .ci/run has no network: it checks the links within the pages (-W), and their anchors.
linkcheck_ignore = [r'https?://(?!127\.0\.0\.1)']

html_theme = 'furo'
html_title = f'barc_sim {version}'
(HERE / '_figures').mkdir(exist_ok=True)  # drawn when the build begins
html_static_path = ['_static', '_figures']
html_css_files = ['pages.css']
html_theme_options = {
    'sidebar_hide_name': False,
    'light_css_variables': {'color-brand-primary': '#00588a', 'color-brand-content': '#00588a'},
    'dark_css_variables': {'color-brand-primary': '#56b4e9', 'color-brand-content': '#56b4e9'},
}
