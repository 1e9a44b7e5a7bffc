"""Imports go one way: pure modules, topics and convert, nodes, run."""

from __future__ import annotations

import ast
import subprocess
import sys
from pathlib import Path

import pytest

import barc_sim

PACKAGE = Path(barc_sim.__file__).parent
ROS_MODULES = {
    f'barc_sim.{name}'
    for name in (
        'composition',
        'convert',
        'cruise_control',
        'endpoints',
        'executor',
        'executor_pool',
        'executor_private',
        'executor_wait',
        'gate',
        'mirrors.markers',
        'mirrors.messages',
        'outlet',
        'page.peers',
        'parameters',
        'peer_watch',
        'process',
        'recorder.describing',
        'recorder.listening',
        'recorder.offers',
        'recorder.polled',
        'recorder.services',
        'ros_graph',
        'simulator_parameters',
        'teleop',
        'tools.looking',
        'tools.messages',
        'tools.parameter_text',
        'tools.parameters',
        'topic_names',
    )
}


def module_name(path: Path) -> str:
    parts = path.relative_to(PACKAGE.parent).with_suffix('').parts
    return '.'.join(part for part in parts if part != '__init__')


NODES = sorted((PACKAGE / 'nodes').glob('*.py'))
PURE_MODULES = sorted(
    {module_name(path) for path in PACKAGE.rglob('*.py') if path not in NODES} - ROS_MODULES
)


def imported(source: str) -> set[str]:
    """Return the absolute names of the modules, and what may be modules, that `source` imports."""
    names = set()
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            package = f'{"." * node.level}{node.module or ""}'
            names |= {package} | {f'{package}.{alias.name}' for alias in node.names}
    return names


#: One after another, in one process: what brings ROS in is the first that is seen to have.
_IMPORT_ALL = """
import importlib, sys
for name in sys.argv[1:]:
    importlib.import_module(name)
    found = {'rclpy', 'barc_interfaces', 'std_msgs'} & set(sys.modules)
    if found:
        sys.exit(f'{name} imports {", ".join(sorted(found))}')
"""


def test_pure_modules_import_no_ros() -> None:
    done = subprocess.run(
        [sys.executable, '-c', _IMPORT_ALL, *PURE_MODULES],
        cwd=PACKAGE.parent,
        capture_output=True,
        text=True,
        check=False,
        timeout=100,
    )
    assert (done.returncode, done.stdout, done.stderr) == (0, '', '')


def test_an_import_of_ros_is_seen() -> None:
    done = subprocess.run(
        [sys.executable, '-c', _IMPORT_ALL, 'barc_sim.road', 'barc_sim.topic_names'],
        cwd=PACKAGE.parent,
        capture_output=True,
        text=True,
        check=False,
        timeout=100,
    )
    assert done.stderr.startswith('barc_sim.topic_names imports ')


@pytest.mark.parametrize('path', NODES, ids=module_name)
def test_node_imports_neither_another_node_nor_the_run(path: Path) -> None:
    forbidden = {
        name
        for name in imported(path.read_text(encoding='utf-8'))
        if name.startswith(('.', 'barc_sim.nodes', 'barc_sim.run'))
    }
    assert not forbidden


@pytest.mark.parametrize(
    'source',
    [
        'import barc_sim.nodes.recorder',
        'from barc_sim.nodes import recorder',
        'from barc_sim.nodes.recorder import BagRecorder',
        'from barc_sim import nodes',
        'if TYPE_CHECKING:\n    from . import recorder',
        'def main():\n    from .recorder import BagRecorder',
    ],
)
def test_every_way_to_import_a_node_is_seen(source: str) -> None:
    assert any(name.startswith(('.', 'barc_sim.nodes')) for name in imported(source))
