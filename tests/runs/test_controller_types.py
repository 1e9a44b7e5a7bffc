"""A controller that is no PID, from the command line to the bag."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

pytest.importorskip('rclpy')

from command_line import barc

from barc_sim.bags import reader

if TYPE_CHECKING:
    from pathlib import Path

pytestmark = pytest.mark.usefixtures('ros_domain')
OPTIONS = ('acc', '--quiet', '--realtime-factor', 'max', '--distance', '30')


@pytest.fixture(scope='module')
def bag(module_domain: int, tmp_path_factory: pytest.TempPathFactory) -> Path:  # noqa: ARG001
    """Return the bag of a run with an LQR."""
    folder = tmp_path_factory.mktemp('run')
    gain = ('--gain', 'speed_weight=100', '--gain', 'observer_gain=1')
    done = barc(*OPTIONS, '--controller-type', 'lqr', *gain, '--bag-dir', str(folder))
    assert (done.returncode, done.stderr) == (0, '')
    return reader.newest(folder)


@pytest.mark.parametrize('command', ['plot', 'report'])
def test_commands_take_the_bag(bag: Path, command: str) -> None:
    done = barc(command, str(bag))
    assert (done.returncode, done.stderr) == (0, '')
    if command == 'report':
        text = (bag / 'report.html').read_text()
        assert 'The terms feedback, compensation over the position' in text


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
