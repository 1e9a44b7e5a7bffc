"""Teleoperation as a user has it: a process in a pseudo-terminal of its own, driven by keys."""

from __future__ import annotations

import os
import signal
import termios
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
import pytest

pytest.importorskip('rclpy')

from hand_drive import drive_by_hand
from rosbags.highlevel import AnyReader
from terminal_session import DEADLINE, READY, Session

from barc_sim.bags import reader as bag
from barc_sim.control.driver import DriverInput, DriverLimits
from barc_sim.control.keyboard import PRESS_HOLD

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path


FAILING = """
from barc_sim.nodes.relay import Relay
def fail(self, twist):
    raise ZeroDivisionError('a fault in a node')
Relay._on_twist = fail
"""
pytestmark = pytest.mark.usefixtures('ros_domain')


@pytest.fixture
def session(tmp_path: Path) -> Iterator[Session]:
    session = Session(tmp_path)
    try:
        session.until(READY)
        session.until(rb'held -')
        yield session
    finally:
        session.close()


def requests(path: Path) -> list[tuple[float, DriverInput]]:
    """Return the recorded `cmd_vel`, at times since the first state."""
    timed_requests = []
    with AnyReader([path]) as reader:
        names = {'/z_vhcl', '/cmd_vel'}
        first = None
        for connection, time_ns, data in reader.messages(
            [c for c in reader.connections if c.topic in names]
        ):
            if connection.topic == '/z_vhcl':
                first = first or time_ns
            elif first:
                twist = reader.deserialize(data, connection.msgtype)
                request = DriverInput(twist.linear.x, twist.angular.z, -twist.linear.z)
                timed_requests.append(((time_ns - first) / 1e9, request))
    return timed_requests


def time_lost(path: Path) -> float:
    """Return the simulated time [s] by which the machine fell behind."""
    return 0.02 * float(bag.info(path)['slipped_periods'])


def test_keys_drive_the_car_as_the_limits_predict_and_the_drive_can_be_repeated(
    session: Session,
) -> None:
    session.hold(b'\x1b[A', 0.8)
    session.type(b'd')
    session.until(rb'held -')
    session.look(0.5)  # coasting
    session.type(b'q')
    assert session.end() == 0

    log = bag.read(session.bag())
    received = requests(session.bag())
    # Where this test is late with a repeat, the key counts as released in between.
    full_throttle = sum(
        after - t for (t, request), (after, _) in pairwise(received) if request.forward == 1.0
    )
    assert full_throttle > PRESS_HOLD

    slack = time_lost(session.bag()) * DriverLimits().acceleration
    expected = full_throttle * DriverLimits().acceleration
    assert log.speed[-1] == pytest.approx(expected, rel=0.05, abs=0.05 * expected + slack)
    # The servo that returns changes the slip angle, and with it the speed.
    assert log.speed[-1] == pytest.approx(log.speed[-10], abs=0.1)
    assert termios.tcgetattr(session.fd) == session.before

    again = drive_by_hand(received, float(log.t[-1]))
    # The nodes' ticks fall elsewhere in the same 50 ms.
    assert again.speed[-1] == pytest.approx(log.speed[-1], abs=0.5 + 4.0 * time_lost(session.bag()))
    assert log.psi[-1] < 0.0
    assert again.psi[-1] == pytest.approx(log.psi[-1], abs=0.2 + time_lost(session.bag()))


def test_keys_steer_brake_and_reset_the_car(session: Session) -> None:
    session.hold(b'w', 0.8)
    session.type(b'a')
    session.until(rb'held -')
    session.type(b' ')
    session.until(rb'speed +0\.00 m/s')
    session.type(b'r')
    session.until(rb' 0\.[0-9] s  speed +0\.00')
    session.look(0.3)
    session.type(b'\x03')
    assert session.end() == 0
    assert termios.tcgetattr(session.fd) == session.before

    log = bag.read(session.bag())
    again = int(np.flatnonzero(np.diff(log.x) < -1.0)[0]) + 1
    assert log.psi[again - 1] > 0.1
    assert log.y[again - 1] > 0.1
    assert log.speed[again - 1] == pytest.approx(0.0, abs=0.01)
    # Where the machine is late, the last command holds for longer than the relay's period.
    assert log.speed.min() >= -0.4
    assert (log.x[again], log.y[again], log.psi[again]) == (0.0, 0.0, 0.0)
    assert np.abs(log.servo).max() <= DriverLimits().steering


@pytest.mark.slow
@pytest.mark.parametrize('number', [signal.SIGHUP, signal.SIGTERM, signal.SIGINT])
def test_a_signal_ends_the_run_and_restores_the_terminal(session: Session, number: int) -> None:
    session.type(b'w')
    session.until('held ↑'.encode())
    session.process.send_signal(number)
    assert session.end() == 0
    assert termios.tcgetattr(session.fd) == session.before
    assert b'Traceback' not in session.shown
    assert len(bag.read(session.bag())) > 1


def test_a_closed_terminal_ends_the_run_and_its_bag(tmp_path: Path) -> None:
    session = Session(tmp_path)
    session.until(READY)
    session.until(rb'held -')
    session.type(b'w')
    os.close(session.fd)
    os.close(session.user)
    session.process.wait(DEADLINE)
    assert 'missed_deadlines' in bag.info(session.bag())  # the bag was closed in order


def test_an_error_in_a_node_restores_the_terminal(tmp_path: Path) -> None:
    session = Session(tmp_path, script=FAILING)
    try:
        session.until(READY)
        session.until(rb'held -')

        session.type(b'w')
        assert session.end() != 0
        assert b'a fault in a node' in session.shown
        assert termios.tcgetattr(session.fd) == session.before
    finally:
        session.close()
