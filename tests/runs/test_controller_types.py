"""A controller that is no PID, from the command line to the bag."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

pytest.importorskip('rclpy')

from command_line import barc

if TYPE_CHECKING:
    from pathlib import Path

pytestmark = pytest.mark.usefixtures('ros_domain')


@pytest.mark.parametrize(
    ('options', 'message'),
    [
        (('--controller-type', 'mpc'), "invalid choice: 'mpc'"),
        (('--gain', 'kp'), "'kp' is no gain: expected NAME=VALUE"),
        (('--gain', 'kp='), "'' is not a number"),
        (('--gain', 'mass=3'), 'mass = 3: the controller pid has no such gain'),
        (
            ('--controller-type', 'lqr', '--gain', 'observer_gain=2'),
            '2 is not a number from 0 to 1',
        ),
        (('--gain', 'observer_gain=1'), 'the controller pid has no such gain; expected one of kp'),
        (('--controller-type', 'lqr', '--kp', '3'), 'kp = 3: the controller lqr has no such gain'),
        (
            ('--no-controller', '--controller-type', 'lqr'),
            '--controller-type and --no-controller: give one',
        ),
        (('--laps', '3', '--distance', '0'), 'laps 3 with distance 0, at which no lap ends'),
        (('--ros-args', '-p', 'controller_type:=mpc'), "'mpc': expected pid or lqr"),
    ],
)
def test_what_the_controller_does_not_have_is_refused(
    tmp_path: Path, options: tuple[str, ...], message: str
) -> None:
    done = barc('acc', '-q', '--bag-dir', str(tmp_path / 'bags'), *options)
    assert done.returncode == 2
    assert message in done.stderr
    assert not (tmp_path / 'bags').exists()
