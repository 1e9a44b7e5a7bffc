"""Definitions of messages and services as text, found by any of their names."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest
from command_line import barc

from barc_sim.bags import schemas
from barc_sim.bags.schemas import definition_lines as lines
from barc_sim.bags.schemas import find_type as find
from barc_sim.errors import UserError

if TYPE_CHECKING:
    from pathlib import Path

ECU = """\
# Command to the vehicle's actuators.

std_msgs/Header header   # stamp: that of the state which this command answers
\tbuiltin_interfaces/Time stamp
\t\tint32 sec
\t\tuint32 nanosec
\tstring frame_id
float64 motor            # [m/s^2] acceleration along the direction of travel
float64 servo            # [rad] front steering angle, positive to the left
"""


@pytest.mark.parametrize('name', ['ECU', 'barc_interfaces/ECU', 'barc_interfaces/msg/ECU'])
def test_a_definition_is_printed_as_ros2_does(name: str) -> None:
    done = barc('show', name)

    assert (done.returncode, done.stdout, done.stderr) == (0, ECU, '')


def test_fields_of_the_same_package_are_expanded() -> None:
    assert '\tfloat64 x' in [*lines('geometry_msgs/msg/Twist')]


def test_without_ros_those_of_a_run_are_there(monkeypatch: pytest.MonkeyPatch) -> None:
    def missing(package: str) -> Path:
        raise LookupError(package)

    monkeypatch.setattr(schemas, 'share', missing)
    monkeypatch.delenv('AMENT_PREFIX_PATH', raising=False)

    assert '\n'.join([*lines(find('ECU')), '']) == ECU
    assert find('Twist') == 'geometry_msgs/msg/Twist'


def test_services_and_those_of_a_workspace_are_found(
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
        ('zzzz', ': barc_interfaces has ControllerState, ECU, EZDynBkMdl'),
    ],
)
def test_a_wrong_name_is_one_sentence(name: str, ends: str) -> None:
    done = barc('show', name)

    assert done.returncode == 2
    assert f'there is no message or service {name!r}{ends}' in done.stderr
