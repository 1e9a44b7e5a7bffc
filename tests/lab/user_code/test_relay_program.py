"""Relays that are programs of ROS 1 or ROS 2, run without ROS and with a clock of their own."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING

import pytest
from relays import (
    CLASS,
    FUNCTION,
    ROS_1,
    ROS_2,
)
from user_files import LocalCode, load_folder, user_text

from barc_sim.lab.files import UserCodeError
from barc_sim.lab.labs.relay import relay_commands
from barc_sim.lab.user_code.code import UserCode
from barc_sim.lab.user_code.folder import TimedCommand, TimedTwist, UserFunction

if TYPE_CHECKING:
    from pathlib import Path


#: Forward and left from 1 to 2 s, released at 2 s.
HELD = [TimedTwist(1.0 + 0.05 * k, 1.0, 1.0) for k in range(20)] + [TimedTwist(2.0, 0.0, 0.0)]
ENDLESS_LOOP = ROS_1.replace('while not rospy.is_shutdown()', 'while True').replace(
    'self.rate.sleep()', 'pass'
)
ENDLESS = '4 s of the relay took longer than'


Load = Callable[[str], UserCode]


def judged(code: UserCode, twists: list[TimedTwist], duration: float) -> list[TimedCommand]:
    return relay_commands(LocalCode(code), twists, duration)


@pytest.fixture
def load(tmp_path: Path) -> Load:
    return partial(code, tmp_path)


def code(folder: Path, text: str) -> UserCode:
    (folder / 'relay.py').write_text(text, encoding='utf-8')
    return load_folder(folder, ['relay'])


def at(commands: list[TimedCommand], t: float) -> TimedCommand:
    """Return the command that holds at `t` [s]."""
    return [command for command in commands if command.t <= t][-1]


def test_other_ways_to_wait_are_a_relay_too(load: Load) -> None:
    once = ROS_2.replace('rclpy.spin(node)', 'while rclpy.ok(): rclpy.spin_once(node)')
    executor = ROS_2.replace(
        'rclpy.spin(node)',
        'e = rclpy.executors.SingleThreadedExecutor(); e.add_node(node); e.spin()',
    )
    unguarded = ROS_2.replace("if __name__ == '__main__':\n    main()\n", '')
    expected = judged(load(ROS_2), HELD, 4.0)

    for text in (executor, unguarded):
        assert judged(load(text), HELD, 4.0) == expected
    for t in (0.5, 1.9, 3.0):
        assert at(judged(load(once), HELD, 4.0), t)[1:] == at(expected, t)[1:]


def test_python_sleep_takes_simulated_time(load: Load) -> None:
    text = ROS_1.replace('self.rate.sleep()', 'time.sleep(0.1)').replace(
        'import rospy\n', 'import rospy\nimport time\n', 1
    )
    assert len(judged(load(text), [], 10.0)) == pytest.approx(100, abs=2)


def test_speed_of_the_car_reaches_a_relay_that_subscribes_to_it(load: Load) -> None:
    commands = judged(load(user_text('relay_by_speed.py')), [], 5.0)
    assert at(commands, 1.5).motor == 1.0
    assert at(commands, 2.5).motor == 0.0


@pytest.mark.parametrize(
    ('text', 'sentence'),
    [
        (
            ROS_2.replace('servo = 0.0', 'servo = 0', 1),
            "after 0.05 s the relay raised AssertionError: The 'motor' field must be of type",
        ),
        (
            ROS_1.replace('2 * msg.linear.x', 'float("nan") * msg.linear.x'),
            'relay.py: after 1.00 s it published motor nan and servo 0.3; expected two finite',
        ),
        (
            ROS_1.replace('2 * msg.linear.x', '2 * mgs.linear.x'),
            "raised NameError: name 'mgs' is not defined: did you mean msg?",
        ),
        (ENDLESS_LOOP, ENDLESS),
        (
            'from rclpy.action import ActionClient\n' + ROS_2,
            'line 1: after 0.00 s the relay raised ImportError: rclpy.action is not part of',
        ),
    ],
)  # fmt: skip
# The end of its time may reach a function that the test's own process calls at a collection.
@pytest.mark.filterwarnings('ignore::pytest.PytestUnraisableExceptionWarning')
def test_each_fault_of_a_relay_program_has_one_sentence(
    load: Load, text: str, sentence: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr('barc_sim.lab.user_code.relay_program._BUDGET', 0.5)
    with pytest.raises(UserCodeError) as caught:
        judged(load(text), HELD, 4.0)
    assert sentence in str(caught.value)


def test_program_that_does_not_wait_is_ended(load: Load, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr('barc_sim.lab.user_code.relay_program._PATIENCE', 0.5)
    never = threading.Event()
    monkeypatch.setattr(math, 'never', never, raising=False)
    text = ROS_1.replace('motor = 2', 'while not never.is_set(): never.wait()\n\tmotor = 2')
    text = text.replace('import rospy', 'import rospy\nfrom math import never', 1)
    program = load(text).new_relay()
    with pytest.raises(UserCodeError, match=r'relay\.py: the relay did not wait'):
        _ = [program(1.0, 0.0, dt=0.05) for _ in range(3)]

    never.set()


def test_program_that_ends_or_fails_while_it_drives_is_a_sentence(load: Load) -> None:
    with pytest.raises(UserCodeError, match='the program of the relay has ended'):
        load(ROS_1.replace('RateRelay().run()', 'RateRelay()')).new_relay()
    failing = load(ROS_1.replace('2 * msg.linear.x', '1 / msg.linear.x')).new_relay()
    assert failing(1.0, 1.0, dt=0.05) == pytest.approx((1.0, 0.3))
    assert [failing(-1.0, -1.0, dt=0.05) for _ in range(3)][-1] == pytest.approx((-1.0, -0.3))
    with pytest.raises(UserCodeError, match=r'line 11: .* raised ZeroDivisionError'):
        failing(0.0, 0.0, dt=0.05)


def test_file_with_the_function_is_called_whatever_it_imports(load: Load) -> None:
    assert isinstance(load('import rospy\n' + FUNCTION).relay, UserFunction)
    assert isinstance(load('import rclpy\n' + CLASS).relay, UserFunction)
