"""The definitions of messages, services and actions: whole, found by name, and printed."""

from __future__ import annotations

import json
import re
from typing import TYPE_CHECKING

import pytest
from command_line import barc
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from barc_sim.cli.process import has_ros
from barc_sim.errors import UserError
from barc_sim.interfaces import definitions
from barc_sim.interfaces.definitions import definition, installed, shipped
from barc_sim.interfaces.definitions import definition_lines as lines
from barc_sim.interfaces.definitions import find_type as find

if TYPE_CHECKING:
    from pathlib import Path

needs_ros = pytest.mark.skipif(not has_ros(), reason='compares with what ROS has installed')


@needs_ros
@pytest.mark.parametrize(('name', 'path'), sorted(shipped()))
def test_definition_and_hash_are_those_of_ros(name: str, path: Path) -> None:
    path_of_ros = installed()[name]
    assert path_of_ros != path
    assert path.read_text(encoding='utf-8') == path_of_ros.read_text(encoding='utf-8')
    content = json.loads(path_of_ros.with_suffix('.json').read_text())
    hashes = {entry['type_name']: entry['hash_string'] for entry in content['type_hashes']}
    types = get_typestore(Stores.EMPTY)
    types.register(get_types_from_msg(definition(name), name))
    assert types.hash_rihs01(name) == hashes[name]


@needs_ros
def test_dependencies_follow_depth_first_and_by_name_under_their_headings() -> None:
    text = definition('nav_msgs/msg/Odometry')
    assert text.startswith(installed()['nav_msgs/msg/Odometry'].read_text())

    assert re.findall(r'\n={80}\nMSG: (\S+)\n', text) == [
        'geometry_msgs/PoseWithCovariance',
        'geometry_msgs/Pose',
        'geometry_msgs/Point',
        'geometry_msgs/Quaternion',
        'geometry_msgs/TwistWithCovariance',
        'geometry_msgs/Twist',
        'geometry_msgs/Vector3',
        'std_msgs/Header',
        'builtin_interfaces/Time',
    ]


@pytest.mark.parametrize('name', ['no_such_msgs/msg/Header', 'std_msgs/msg/NoSuchType', '../a/B'])
def test_a_type_that_is_not_installed_is_named(name: str) -> None:
    with pytest.raises(LookupError, match=f"'{name}' is not installed"):
        definition(name)


TEXT = """\
# Command to the vehicle's actuators.

std_msgs/Header header   # stamp: as in the state message that this command answers
\tbuiltin_interfaces/Time stamp
\t\tint32 sec
\t\tuint32 nanosec
\tstring frame_id
float64 motor            # [m/s^2] acceleration along the direction of travel
float64 servo            # [rad] front steering angle, positive to the left
"""


@pytest.mark.parametrize('name', ['ECU', 'barc_interfaces/ECU', 'barc_interfaces/msg/ECU'])
def test_a_definition_is_printed_as_ros2_does(name: str) -> None:
    process = barc('show', name)

    assert (process.returncode, process.stdout, process.stderr) == (0, TEXT, '')


def test_without_ros_the_definitions_of_a_run_are_found(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(definitions, '_files', lambda _: dict(shipped()))
    assert '\n'.join([*lines(find('ECU')), '']) == TEXT
    assert find('Twist') == 'geometry_msgs/msg/Twist'


def test_services_and_the_definitions_of_a_workspace_are_found(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / 'share' / 'my_msgs'
    for kind, text in (('msg', 'int32[<=3] a\nOther[] others\n'), ('srv', 'bool on\n---\n')):
        (folder / kind).mkdir(parents=True)
        (folder / kind / f'Switch.{kind}').write_text(text)
    (folder / 'msg' / 'Other.msg').write_text('# no\n\nstring<=5 name "x"  # no\nint8 A=1\n')
    monkeypatch.setenv('AMENT_PREFIX_PATH', str(tmp_path))

    assert [*lines(find('my_msgs/srv/Switch'))] == ['bool on', '---']
    assert [*lines('my_msgs/msg/Switch')] == [
        'int32[<=3] a', 'Other[] others', '\tstring<=5 name "x"', '\tint8 A=1',
    ]  # fmt: skip
    with pytest.raises(UserError, match='several types: name one of my_msgs/msg/Switch, my_msgs/s'):
        find('Switch')


@pytest.mark.parametrize(
    ('name', 'ends'),
    [
        ('ecu', ': did you mean ECU?'),
        ('barc_interfaces/Environmet', ': did you mean barc_interfaces/Environment'),
        ('zzzz', ': barc_interfaces has AppliedCommand, ControllerState, ECU, EZDynBkMdl'),
    ],
)
def test_a_wrong_name_is_refused_with_the_nearest_one(name: str, ends: str) -> None:
    process = barc('show', name)

    assert process.returncode == 2
    assert f'there is no message, service or action {name!r}{ends}' in process.stderr
