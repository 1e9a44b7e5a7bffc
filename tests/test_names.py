"""No class name stands twice, none is one of rclpy's, and no record is read by position."""

from __future__ import annotations

import ast
from collections import defaultdict
from importlib.util import find_spec
from pathlib import Path

import pytest
from positions import positions

import barc_sim

PACKAGE = Path(barc_sim.__file__).parent
#: Files for students repeat one another on purpose: each lab's folder has its own.
SOURCES = {
    str(path.relative_to(PACKAGE)): path.read_text('utf-8')
    for path in sorted(PACKAGE.rglob('*.py'))
    if 'templates' not in path.parts
}
#: It stands in for rclpy, so its classes have rclpy's names: the same nodes run on both.
STAND_IN = 'ros/local/'


def classes(source: str) -> list[str]:
    """Return the names of the classes that a file defines."""
    return [node.name for node in ast.walk(ast.parse(source)) if isinstance(node, ast.ClassDef)]


def test_no_class_name_stands_twice() -> None:
    places = defaultdict(list)
    for file, source in SOURCES.items():
        for name in classes(source):
            places[name].append(file)
    assert {name: files for name, files in places.items() if len(files) > 1} == {}


def test_no_class_has_a_name_of_rclpy() -> None:
    spec = find_spec('rclpy')
    if spec is None or spec.origin is None:
        pytest.skip('compares with the classes of rclpy')
    names_of_rclpy = {
        name
        for path in Path(spec.origin).parent.rglob('*.py')
        for name in classes(path.read_text('utf-8'))
    }
    assert {'Node', 'Parameter', 'Publisher'} <= names_of_rclpy

    wrong = {
        file: names
        for file, source in SOURCES.items()
        if not file.startswith(STAND_IN) and (names := {*classes(source)} & names_of_rclpy)
    }
    assert wrong == {}


def test_no_record_is_read_by_position() -> None:
    assert positions(SOURCES) == []


DECLARED = (Path(__file__).with_name('programs') / 'records.py').read_text('utf-8')
IMPORT = 'from barc_sim.a import Place, Pose\n'


@pytest.mark.parametrize(
    'read',
    [
        'def f(pose: Pose): return pose[0]',
        'def f(pose: Pose | None): x, y = pose',
        'def f(poses: Sequence[Pose]):\n    for x, y in poses: pass',
        'def f(poses: Iterable[Pose]): return [x for x, _ in poses]',
        'def f(track): return track.place(1.0)[1]',
        'def f(track): return State(*track.start)',
        'def f(track): return {y: x for x, y in track.poses}',
        'def f(place: Place): return hypot(*place.pose)',
        'def f():\n    pose = Pose(1.0, 2.0)\n    return pose[:1]',
        'def f(pose: Pose):\n    moved = pose._replace(x=1.0)\n    x, y = moved',
        'def f(poses: list[Pose]):\n    for pose in poses:\n        x, y = pose',
        'def f(poses: dict[str, Pose]):\n    for name, (x, y) in poses.items(): pass',
        'x, y = Pose(1.0, 2.0)',
    ],
)
def test_a_reading_by_position_is_found(read: str) -> None:
    assert len(positions({'a.py': DECLARED, 'b.py': IMPORT + read})) == 1


@pytest.mark.parametrize(
    'read',
    [
        'def f(pose: Pose): return pose.x',
        'def f(poses: list[Pose]): return poses[0].x',
        'def f(pairs: list[tuple[float, Pose]]):\n    for t, pose in pairs: pass',
        'def f(pose: Pose): return dict(zip(pose._fields, pose))',
        'def f(pose: Pose): return [*pose, 1.0]',
        'def f(poses: dict[str, Pose]):\n    for name, pose in poses.items(): pass',
        'def f(names: list[str]): return names[0]',
        'def f(pose: Pose):\n    pose = [1.0]\n    return pose[0]',
    ],
)
def test_other_readings_are_not_found(read: str) -> None:
    assert positions({'a.py': DECLARED, 'b.py': IMPORT + read}) == []
