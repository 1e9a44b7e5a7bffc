"""Imports go one way: each room from those before it, and without ROS up to `lab`."""

from __future__ import annotations

import ast
import os
import subprocess
import sys
from graphlib import TopologicalSorter
from importlib.util import find_spec
from pathlib import Path

import pytest
from elsewhere import ELSEWHERE

import barc_sim

PACKAGE = Path(barc_sim.__file__).parent
IMPORT_MODULES = Path(__file__).with_name('programs') / 'import_modules.py'
#: Each room imports those before it, and never those behind.
ROOMS = (
    'errors',
    'cli',
    'parallel',
    'interfaces',
    'vehicle',
    'control',
    'simulation',
    'tuning',
    'bags',
    'figures',
    'learning',
    'page',
    'lab',
    'ros',
    'nodes',
    'runs',
    'commands',
)
WITHOUT_ROS = ROOMS[: ROOMS.index('ros')]
#: Rooms that a room before them in line must not see all the same.
NOT_SEEN = {room: {'tuning', 'learning', 'figures', 'lab'} for room in ('ros', 'nodes')}
#: Modules that need a package of an extra, by file.
NEEDED = {'environments.py': 'gymnasium', 'workers.py': 'distributed'}
ROS = {'barc_interfaces', 'rclpy', 'rosidl_runtime_py', 'rpyutils'}
#: Those whose package asks for its system.
NEEDS_SYSTEM = {'workers.py'}


def module_name(path: Path) -> str:
    parts = path.relative_to(PACKAGE.parent).with_suffix('').parts
    return '.'.join(part for part in parts if part != '__init__')


def _can_be_imported(path: Path) -> bool:
    return path.name not in NEEDED or find_spec(NEEDED[path.name]) is not None


def modules(*rooms: str) -> list[Path]:
    return sorted(
        path
        for room in rooms
        for path in (*(PACKAGE / room).rglob('*.py'), PACKAGE / f'{room}.py')
        if path.exists() and 'templates' not in path.parts and _can_be_imported(path)
    )


def imported(source: str, package: str = 'barc_sim') -> set[str]:
    """Return the absolute names of the modules, and what may be modules, that `source` imports."""
    names = set()
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            parents = package.split('.')[: -node.level or None] if node.level else []
            module = '.'.join([*parents, *([node.module] if node.module else [])])
            names |= {module} | {f'{module}.{alias.name}' for alias in node.names}
    return names


def rooms_of(names: set[str]) -> set[str]:
    """Return the rooms of modules; what needs no ROS may be used by `lab`, too."""
    rooms_in_names = {
        name.split('.')[1]
        for name in names
        if name.startswith('barc_sim.') and not name.startswith('barc_sim.ros.local')
    }
    return rooms_in_names & {*ROOMS, 'run', '__main__'}


@pytest.mark.parametrize('room', ROOMS)
def test_room_imports_only_those_before_it(room: str) -> None:
    allowed = set(ROOMS[: ROOMS.index(room) + 1]) - NOT_SEEN.get(room, set())
    wrong = {
        module_name(path): others
        for path in modules(room)
        if (others := rooms_of(imported(path.read_text('utf-8'), module_name(path))) - allowed)
    }
    assert wrong == {}


def test_the_stand_in_for_rclpy_imports_nothing_of_ros() -> None:
    wrong = {
        module_name(path): others
        for path in modules('ros/local')
        if (
            others := rooms_of(imported(path.read_text('utf-8'), module_name(path)))
            - {'errors', 'cli', 'interfaces', 'bags'}
        )
    }
    users = {
        path.relative_to(PACKAGE).parts[0]
        for path in modules(*ROOMS)
        if any('barc_sim.ros.local' in name for name in imported(path.read_text('utf-8')))
    }

    assert wrong == {}
    assert users <= {'lab', 'ros', 'nodes', 'runs', 'commands'}


def test_no_modules_import_one_another_in_a_circle() -> None:
    files = {module_name(path): path.read_text('utf-8') for path in modules(*ROOMS)}
    TopologicalSorter(
        {name: imported(text, name) & files.keys() for name, text in files.items()}
    ).prepare()


def test_nodes_import_no_other_node() -> None:
    files = {module_name(path): path.read_text('utf-8') for path in modules('nodes')}
    nodes = {name for name, text in files.items() if '(Node):' in text}
    wrong = {name: imported(files[name], name) & (nodes - {name}) for name in nodes}
    assert not any(wrong.values()), wrong


@pytest.mark.parametrize(
    'source',
    [
        'import barc_sim.nodes.recorder',
        'from barc_sim.nodes import recorder',
        'from barc_sim.nodes.recorder import BagRecorder',
        'from barc_sim import nodes',
        'if TYPE_CHECKING:\n    from . import nodes',
        'def main():\n    from .nodes.recorder import BagRecorder',
    ],
)
def test_every_way_to_import_is_recognised(source: str) -> None:
    assert rooms_of(imported(source, 'barc_sim.errors')) == {'nodes'}


def import_without_ros(*names: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, IMPORT_MODULES, ','.join(ROS), *names],
        env=os.environ | {'PYTHONPATH': str(PACKAGE.parent)},
        capture_output=True,
        text=True,
        check=False,
        timeout=200,
    )


def test_rooms_up_to_lab_can_be_imported_without_ros() -> None:
    process = import_without_ros(*map(module_name, modules(*WITHOUT_ROS, 'ros/local')))
    assert (process.returncode, process.stdout, process.stderr) == (0, '', '')


def test_rooms_without_ros_need_nothing_that_only_linux_has() -> None:
    rooms = (*WITHOUT_ROS, 'commands', 'ros/local', 'runs/terminal')
    names = map(module_name, (path for path in modules(*rooms) if path.name not in NEEDS_SYSTEM))
    code = 'import importlib, sys\nfor name in sys.argv[1:]: importlib.import_module(name)'
    process = subprocess.run(
        [sys.executable, '-c', code, *names],
        env=os.environ | ELSEWHERE,
        capture_output=True,
        text=True,
        check=False,
        timeout=200,
    )

    assert (process.returncode, process.stdout) == (0, ''), process.stderr


def test_an_import_of_ros_is_refused() -> None:
    process = import_without_ros('barc_sim.vehicle.road', 'barc_sim.ros.topics')
    assert 'is of ROS' in process.stderr
