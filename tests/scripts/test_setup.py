"""The set-up's errors and the versions that must agree; .ci/run makes a whole set-up."""

from __future__ import annotations

import configparser
import os
import re
import shutil
import subprocess
import sys
import sysconfig
import zipfile
from pathlib import Path
from xml.etree import ElementTree as ET

import pytest

import barc_sim

ROOT = Path(__file__).parents[2]
PROGRAMS = Path(__file__).with_name('programs')
SCRIPTS = [*sorted((ROOT / 'scripts').iterdir()), *sorted((ROOT / '.ci').iterdir())]
SHELL_SCRIPTS = [
    path for path in SCRIPTS if path.is_file() and b'bash' in path.read_bytes().split(b'\n', 1)[0]
]
TOOLS = ('awk', 'bash', 'cksum', 'df', 'flock', 'mkdir', 'readlink', 'uname')
COMPILERS = ('c++', 'cc')
SETUP = configparser.ConfigParser(interpolation=None)
SETUP.read(ROOT / 'setup.cfg')
INTERFACES = (ROOT / 'barc_interfaces' / 'pyproject.toml').read_text()


@pytest.fixture
def checkout(tmp_path: Path) -> Path:
    """Return a copy of what the set-up reads, in a directory whose name has a space."""
    copy = tmp_path / 'my checkout'
    for name in ('barc_interfaces', 'requirements', 'resource', 'scripts'):
        shutil.copytree(ROOT / name, copy / name)
    for name in ('setup.cfg', 'setup.py', 'package.xml', 'pyproject.toml'):
        shutil.copy(ROOT / name, copy)
    for name in ('barc_sim/commands/__init__.py', 'barc_sim/interfaces/nodes.py'):
        (copy / name).parent.mkdir(parents=True)
        shutil.copy(ROOT / name, copy / name)
    return copy


def programs(directory: Path, *names: str, **scripts: str) -> Path:
    """Make a directory for PATH that holds these programs of this machine, and these scripts."""
    directory.mkdir()
    for name in names:
        (directory / name).symlink_to(str(shutil.which(name)))
    for name, text in scripts.items():
        write_script(directory / name, text)
    return directory


def write_script(path: Path, text: str) -> None:
    path.write_text(f'#!{shutil.which("bash")}\n{text}\n', encoding='utf-8')
    path.chmod(0o755)


def run(checkout: Path, path: Path | str, **environment: str) -> subprocess.CompletedProcess[str]:
    """Call the checkout's scripts/run with nothing but `path` on PATH and no ROS sourced."""
    return subprocess.run(
        [str(checkout / 'scripts' / 'run'), 'acc'],
        cwd=checkout.parent,
        env={'PATH': str(path), 'BARC_PYTHON': sys.executable} | environment,
        capture_output=True,
        text=True,
        timeout=200,
        check=False,
    )


def sentence(process: subprocess.CompletedProcess[str]) -> str:
    """Return the one line that a failed set-up prints."""
    assert process.returncode == 1
    assert process.stdout == ''
    (line,) = process.stderr.splitlines()
    assert line.startswith('barc_sim: ')
    assert line.endswith('.')
    return line


@pytest.mark.parametrize('script', SHELL_SCRIPTS, ids=lambda path: path.name)
def test_each_script_is_valid_bash(script: Path) -> None:
    process = subprocess.run(
        [str(shutil.which('bash')), '-n', str(script)], capture_output=True, text=True, check=False
    )
    assert (process.returncode, process.stderr) == (0, '')


@pytest.mark.parametrize('script', ['run', 'test'])
def test_a_script_that_sh_starts_is_run_by_bash(
    checkout: Path, tmp_path: Path, script: str
) -> None:
    path = programs(tmp_path / 'bin', *TOOLS, 'sh')
    process = subprocess.run(
        ['sh', str(checkout / 'scripts' / script)],  # noqa: S607 (of `path`)
        env={'PATH': str(path), 'BARC_PYTHON': sys.executable},
        capture_output=True,
        text=True,
        check=False,
    )

    assert 'a C++ compiler must be installed' in sentence(process)


def test_missing_compiler_is_named(checkout: Path, tmp_path: Path) -> None:
    line = sentence(run(checkout, programs(tmp_path / 'bin', *TOOLS)))
    assert 'a C++ compiler must be installed' in line
    assert 'or drive without ROS (export BARC_ROS=none)' in line
    assert not (checkout / '.venv').exists()


def test_all_that_is_missing_is_named_at_once(checkout: Path, tmp_path: Path) -> None:
    version = sysconfig.get_python_version()
    path = programs(tmp_path / 'bin', *TOOLS)
    # The script asks the interpreter where it lies, and uses that one from then on.
    about = f'[[ $* != *realpath* ]] || {{ echo {version} wheels {path / "python"}; exit; }}'
    no_venv = f'[[ $* == *ensurepip* ]] && exit 1; exec "{sys.executable}" "$@"'
    write_script(path / 'python', f'{about}; {no_venv}')
    line = sentence(run(checkout, path, BARC_PYTHON=str(path / 'python')))

    assert f"a C++ compiler and Python {version}'s venv module must be installed" in line
    assert f'sudo apt install g++ python{version}-venv' in line


@pytest.mark.parametrize(
    ('environment', 'message'),
    [
        *(
            ({'VERSION': version}, f'3.12 or 3.13 is needed, but python3 is Python {version}')
            for version in ('2.7', '3.9', '3.14')
        ),
        ({'BARC_PYTHON': '/opt/python'}, 'is needed, but /opt/python is not there'),
        (
            {'ROS_DISTRO': 'humble', 'AMENT_PREFIX_PATH': '/opt/ros/humble'},
            "ROS 2 Jazzy is needed, but 'humble' is sourced",
        ),
        ({'BARC_ROS': 'no'}, "BARC_ROS can be none, to set up without ROS, and not 'no': unset it"),
        ({'BARC_LOCK': 'no'}, "and not 'no': unset it"),
    ],
)
def test_an_unusable_python_ros_or_setting_is_named(
    checkout: Path, tmp_path: Path, environment: dict[str, str], message: str
) -> None:
    python = 'echo $VERSION wheels /bin/python'
    path = programs(tmp_path / 'bin', *TOOLS, *COMPILERS, python3=python)
    default_python = {'BARC_PYTHON': ''} if 'VERSION' in environment else {}
    assert message in sentence(run(checkout, path, **default_python | environment))


#: What a Mac has, and Git Bash.
POSIX = ('awk', 'bash', 'cksum', 'cp', 'df', 'env', 'find', 'grep', 'mkdir', 'readlink', 'rm')


def python_without_ros(folder: str) -> str:
    """Return the script of a Python whose virtual environments have their programs in `folder`."""
    text = (PROGRAMS / 'python_without_ros.sh').read_text('utf-8')
    return text.replace('FOLDER', folder)


@pytest.mark.parametrize(
    ('system', 'folder'), [('Darwin arm64', 'bin'), ('MINGW64_NT-10.0 x86_64', 'Scripts')]
)
def test_where_pypi_has_no_ros_barc_is_set_up_without_it(
    checkout: Path, tmp_path: Path, system: str, folder: str
) -> None:
    scripts = {'python3': python_without_ros(folder), 'uname': f'echo {system}'}
    path = programs(tmp_path / 'bin', *POSIX, **scripts)
    first = run(checkout, path, BARC_PYTHON='')
    assert first.returncode == 0, first.stderr
    assert first.stdout.startswith('drives: -P -c import sys')
    assert first.stdout.endswith(' acc\n')
    assert (
        f'without ROS, which PyPI has for x86-64 Linux alone, and this is {system}'
        in (first.stderr.splitlines()[0])
    )

    installed = (checkout / '.setup' / 'log').read_text()
    locked, editable = re.findall('pip install .*', installed)
    assert '--require-hashes --no-deps' in locked
    assert locked.endswith('--requirement requirements/run.txt')
    assert '--no-index --no-deps --no-build-isolation' in editable
    assert editable.endswith('-e .')

    again = run(checkout, path, BARC_PYTHON='')
    assert (again.returncode, again.stdout, again.stderr) == (0, first.stdout, '')


def test_barc_ros_none_needs_no_compiler(checkout: Path, tmp_path: Path) -> None:
    path = programs(tmp_path / 'bin', *POSIX, 'uname', python3=python_without_ros('bin'))
    process = run(checkout, path, BARC_PYTHON='', BARC_ROS='none', ROS_DISTRO='humble')
    assert process.returncode == 0, process.stderr


@pytest.mark.slow
def test_a_file_with_another_hash_is_named_and_not_installed(
    checkout: Path, tmp_path: Path
) -> None:
    folder = tmp_path / 'index' / 'mdurl'
    folder.mkdir(parents=True)
    wheel = folder / 'mdurl-0.1.2-py3-none-any.whl'
    with zipfile.ZipFile(wheel, 'w') as archive:
        archive.writestr('mdurl-0.1.2.dist-info/METADATA', 'Name: mdurl\nVersion: 0.1.2\n')
        archive.writestr('mdurl-0.1.2.dist-info/WHEEL', 'Wheel-Version: 1.0\nTag: py3-none-any\n')
        archive.writestr('mdurl-0.1.2.dist-info/RECORD', '')
        archive.writestr('mdurl.py', 'tampered = True')
    (folder / 'index.html').write_text(f'<a href="{wheel.name}">{wheel.name}</a>')
    lock = checkout / 'requirements' / 'run.txt'
    (pin,) = re.findall(r'^mdurl==.*\n(?: .*\n)*', lock.read_text(), re.MULTILINE)
    lock.write_text(pin)
    index = {'PIP_INDEX_URL': folder.parent.as_uri(), 'PIP_CONFIG_FILE': os.devnull}
    process = run(checkout, os.environ['PATH'], BARC_ROS='none', **index)
    assert process.returncode == 1

    line = process.stderr.splitlines()[-1]
    assert line.startswith('barc_sim: what PyPI, or its mirror, sent as mdurl==0.1.2 has another')
    assert not [*checkout.glob('.venv/**/mdurl*')]


def test_an_environment_that_others_made_is_left_alone(checkout: Path) -> None:
    (checkout / '.venv').mkdir()
    (checkout / '.venv' / 'mine').touch()
    process = run(checkout, os.environ['PATH'])
    assert 'was not made by this script: move it out of the way' in process.stderr
    assert process.returncode == 1
    assert (checkout / '.venv' / 'mine').exists()


def test_checkout_that_cannot_be_written_to_is_named(checkout: Path, tmp_path: Path) -> None:
    (checkout / '.setup').touch()
    path = programs(tmp_path / 'bin', *TOOLS, *COMPILERS)
    assert f'{checkout} cannot be written to' in sentence(run(checkout, path))


def test_all_files_have_the_same_version() -> None:
    versions = {
        SETUP['metadata']['version'],
        ET.parse(ROOT / 'package.xml').findtext('version'),
        ET.parse(ROOT / 'barc_interfaces' / 'package.xml').findtext('version'),
        *re.findall(r'^version = "(.*)"$', INTERFACES, re.MULTILINE),
        *re.findall(r'^version: (.+)$', (ROOT / 'CITATION.cff').read_text(), re.MULTILINE),
    }
    assert versions == {barc_sim.__version__}


def test_both_packages_need_the_same_versions_of_python() -> None:
    (versions,) = re.findall(r"python_requires='(.*)'", (ROOT / 'setup.py').read_text())
    assert f'requires-python = "{versions}"' in INTERFACES


def test_every_wheel_of_ros_is_pinned_to_one_version() -> None:
    wheels = re.findall(r'"(ros-[^"]*)"', INTERFACES)
    assert wheels
    assert [wheel for wheel in wheels if '==' not in wheel] == []
    assert len(dict(wheel.split('==') for wheel in wheels)) == len(set(wheels))


def test_robostack_gets_what_barc_sim_requires() -> None:
    requirements = dict(
        re.findall(r'^([\w-]+)(>=.*)$', SETUP['options']['install_requires'], re.MULTILINE)
    )
    requirements['matplotlib-base'] = requirements.pop('matplotlib')
    text = (ROOT / 'pixi.toml').read_text(encoding='utf-8')
    assert (
        requirements.items() <= dict(re.findall(r'^([\w-]+) = "(.*)"$', text, re.MULTILINE)).items()
    )


def test_each_requirement_is_a_key_of_rosdep_or_in_the_line_for_pip() -> None:
    manifest = (ROOT / 'package.xml').read_text(encoding='utf-8')
    page = (ROOT / 'docs' / 'how-to' / 'platforms.md').read_text(encoding='utf-8')
    keys = {'pillow': 'pil', 'pyyaml': 'yaml'}

    for requirement in SETUP['options']['install_requires'].split():
        name = re.split('[><]', requirement)[0]
        if f'<exec_depend>python3-{keys.get(name, name)}</exec_depend>' not in manifest:
            (comment,) = re.findall('<!-- (From PyPI.*?) -->', manifest, re.DOTALL)
            assert name in comment
            assert f"'{requirement}'" in page


def test_a_sourced_ros_gets_no_wheel_of_ros() -> None:
    extras = dict(SETUP['options.extras_require'])
    del extras['testwheels']  # which the set-up asks for only without a sourced ROS
    listed = SETUP['options']['install_requires'] + str(extras)
    assert 'ros-' not in listed
    assert 'barc' not in listed
