"""The bags of both engines are the same, when the same hand drives."""

from __future__ import annotations

import json
import signal
import subprocess
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from itertools import groupby
from typing import TYPE_CHECKING, Any

import pytest

pytest.importorskip('rclpy')

from command_line import call, messages, started
from page_client import connect_page, rows
from rosbags.highlevel import AnyReader

if TYPE_CHECKING:
    from pathlib import Path

#: A relay without a memory: its commands depend on nothing but the latest request.
RELAY = 'def relay(linear_x, angular_z):\n    return [2.5 * linear_x, 0.25 * angular_z]\n'
#: Of the driver: for so many states from the first on that moves, forward and turn.
DRIVE = [(6, 1.0, 0.0), (5, 1.0, 0.5), (5, 0.5, -0.25), (4, -1.0, 0.125)]
#: A step takes 0.2 s: a request that is made at a state is a command long before the next.
FACTOR = '0.1'
TRIES = 3  #: on a machine that stalls for longer


def request(moved: int) -> tuple[float, float] | None:
    """Return forward and turn for the state number `moved` of those that move; None at the end."""
    for count, forward, turn in DRIVE:
        moved -= count
        if moved < 0:
            return forward, turn
    return None


def drive(engine: str, folder: Path) -> Path:
    """Drive from the page of a run, as `DRIVE` says; return the bag."""
    folder.mkdir()
    (folder / 'relay.py').write_text(RELAY, encoding='utf-8')
    words = ('--engine', engine, '--relay', 'relay.py', '--realtime-factor', FACTOR)
    with started('teleop', *words, cwd=folder, stderr=subprocess.DEVNULL) as process:
        assert process.stdout
        url = next(line.split()[-1] for line in process.stdout if line.startswith('live page'))
        with connect_page(url) as socket:
            moved = 0
            while (wanted := request(moved)) is not None:
                forward, turn = wanted
                socket.send(json.dumps({'type': 'drive', 'linear': forward, 'angular': turn}))
                with suppress(TimeoutError):
                    received = socket.recv(timeout=0.02)
                    moved += sum(row['speed'] > 0.0 for row in rows(received))
        process.send_signal(signal.SIGINT)
        process.stdout.read()
        assert process.wait(30.0) == 0
    (bag,) = (folder / 'bags').iterdir()
    return bag


def types(bag: Path) -> dict[str, tuple[str, Any]]:
    """Return the type and the definition of each topic."""
    with AnyReader([bag]) as reader:
        return {each.topic: (each.msgtype, each.msgdef.data) for each in reader.connections}


def moves(bag: Path) -> list[tuple[object, ...]]:
    """Return stamps [ns] and values of the states from the last one at rest on."""
    found = []
    for state in messages(bag)['/z_vhcl']:
        stamp = state.header.stamp.sec * 1_000_000_000 + state.header.stamp.nanosec
        found.append((stamp, state.x, state.y, state.psi, state.v_x, state.v_y, state.psi_dot))
    first = next(k for k, state in enumerate(found) if state[4]) - 1
    count = sum(each[0] for each in DRIVE)
    begin = found[first][0]
    return [(stamp - begin, *values) for stamp, *values in found[first : first + count]]


def requests(bag: Path) -> list[tuple[float, float]]:
    """Return the different requests on `cmd_vel`, one after the other."""
    twists = [(each.linear.x, each.angular.z) for each in messages(bag)['/cmd_vel']]
    return [twist for twist, _ in groupby(twists)]


@pytest.mark.slow
@pytest.mark.usefixtures('ros_domain')
def test_bags_are_equal(tmp_path: Path) -> None:
    for attempt in range(TRIES):
        folder = tmp_path / str(attempt)
        folder.mkdir()
        with ThreadPoolExecutor() as pool:
            runs = [pool.submit(drive, name, folder / name) for name in ('ros', 'local')]
            ros, local = (run.result() for run in runs)
        for bag in (ros, local):
            done = call('regrade', str(bag))
            assert done.returncode == 0, done.stdout + done.stderr
        assert types(local) == types(ros)
        wanted = [(forward, turn) for _, forward, turn in DRIVE]
        assert requests(local)[: len(wanted)] == requests(ros)[: len(wanted)] == wanted
        if moves(local) == moves(ros):
            break
    assert moves(local) == moves(ros)
    assert len(moves(local)) == sum(each[0] for each in DRIVE)
