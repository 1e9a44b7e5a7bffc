"""The keyboard node in a pseudo-terminal: what keys publish, and how it ends."""

from __future__ import annotations

import os
import pty
import termios
import time
from itertools import groupby
from typing import TYPE_CHECKING

import pytest

pytest.importorskip('rclpy')

from geometry_msgs.msg import Twist
from node_bench import NodeBench
from std_srvs.srv import Trigger

from barc_sim.control.driver import COAST, FULL_BRAKE, DriverInput
from barc_sim.control.keyboard import Terminal
from barc_sim.interfaces import qos, services
from barc_sim.nodes.keyboard import Keyboard
from barc_sim.ros.conversions import to_driver_input

if TYPE_CHECKING:
    from collections.abc import Callable

    from rclpy.context import Context

UP, LEFT = DriverInput(forward=1.0), DriverInput(turn=1.0)


class Bench(NodeBench):
    """A keyboard node on a pseudo-terminal, and a node that receives from it and can be reset."""

    def __init__(self, context: Context, spin_until: Callable[..., None]) -> None:
        self.user, self.fd = pty.openpty()
        self.before = termios.tcgetattr(self.fd)
        self.received: list[DriverInput] = []
        self.resets = 0
        self.keyboard = Keyboard(Terminal(self.fd), context=context)
        super().__init__(context, spin_until, self.keyboard)
        self.peer.create_subscription(Twist, 'cmd_vel', self._on_twist, qos.DEFAULT)
        self.peer.create_service(Trigger, services.RESET_SIMULATOR, self._on_reset)

    def _on_twist(self, twist: Twist) -> None:
        self.received.append(to_driver_input(twist))

    def _on_reset(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        self.resets += 1
        return response

    def type(self, data: bytes) -> None:
        """Send what keys send."""
        os.write(self.user, data)

    @property
    def changes(self) -> list[DriverInput]:
        """The inputs received, without repetitions."""
        return [request for request, _ in groupby(self.received)]

    def close(self) -> None:
        """End the nodes, and hang up."""
        super().close()
        os.close(self.fd)
        os.close(self.user)


@pytest.fixture
def bench(benches: Callable[..., Bench]) -> Bench:
    return benches(Bench)


def test_a_press_drives_then_coasts_once_and_publishes_no_more(bench: Bench) -> None:
    bench.type(b'w')
    bench.until(lambda: COAST in bench.received)
    assert bench.changes == [UP, COAST]
    assert bench.received.count(UP) > 5
    count, end = len(bench.received), time.monotonic() + 0.3
    bench.until(lambda: time.monotonic() > end)
    assert len(bench.received) == count


def test_a_held_key_calls_the_reset_once(bench: Bench) -> None:
    bench.until(lambda: bench.keyboard.count_publishers('cmd_vel') == 1)
    bench.type(b'rrrr')
    bench.until(lambda: bench.resets == 1)
    bench.type(b'w')
    bench.until(lambda: COAST in bench.received)
    assert bench.resets == 1
    assert bench.changes == [UP, COAST]


@pytest.mark.parametrize('key', [b'q', b'\x03'])
def test_quit_restores_the_terminal_and_finishes(bench: Bench, key: bytes) -> None:
    bench.type(key)
    bench.until(bench.keyboard.finished.done)
    # The terminal is restored in a callback of that future.
    bench.until(lambda: termios.tcgetattr(bench.fd) == bench.before)


def test_a_keyboard_that_ends_publishes_the_full_brake(bench: Bench) -> None:
    bench.type(b'w')
    bench.until(lambda: UP in bench.received)
    bench.executor.remove_node(bench.keyboard)
    bench.keyboard.destroy_node()
    bench.until(lambda: FULL_BRAKE in bench.received)
    assert termios.tcgetattr(bench.fd) == bench.before
