"""Runs killed at any moment: what their bags still hold, against what a subscriber saw.

`BARC_SIM_SOAK=1 pytest tests/test_kill.py` kills 100 runs, and holds them to 0.25 s.
"""

from __future__ import annotations

import json
import os
import random
import subprocess
import sys
import time
from contextlib import contextmanager
from typing import TYPE_CHECKING, NamedTuple

import pytest

pytest.importorskip('rclpy')

import mcap_doctor
from command_line import wait_for

from barc_sim.bags import reader as bag
from barc_sim.bags.contents import Contents
from barc_sim.bags.recovery import recover

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

SOAK = 'BARC_SIM_SOAK' in os.environ
RUNS = 100 if SOAK else 4
PARTS = [pytest.param(run, marks=[pytest.mark.slow] * (run > 0)) for run in range(RUNS)]
#: [ns] A machine that is busy with other tests may stall the recorder.
MOST_LOST = 250_000_000 if SOAK else 2_000_000_000
#: Prints the states that it receives, one in a line.
WITNESS = """
import json, time
import rclpy
from barc_interfaces.msg import ZDynBkMdl
from rclpy.node import Node
from barc_sim.ros.polled import Taker

rclpy.init()
node = Node('witness')
subscription = node.create_subscription(ZDynBkMdl, 'z_vhcl', lambda _: None, 10_000, raw=True)
taker = Taker(node)
print(flush=True)
while True:
    for data, published, received, number, _ in taker.take(subscription, 10_000):
        print(json.dumps((data.hex(), published, received, number)), flush=True)
    time.sleep(0.01)
"""


class Seen(NamedTuple):
    """A state as the witness saw it."""

    data: str
    published: int
    received: int
    number: int


@contextmanager
def process(*arguments: str, stdout: Path) -> Iterator[None]:
    """Run Python; it is killed at the end."""
    with (
        stdout.open('w', encoding='utf-8') as stream,
        subprocess.Popen(
            [sys.executable, *arguments],
            stdout=stream,
        ) as started,
    ):
        try:
            yield
        finally:
            started.kill()


@pytest.mark.timeout(1800)
@pytest.mark.usefixtures('ros_domain')
@pytest.mark.parametrize('run', PARTS)
def test_a_killed_run_misses_a_quarter_second_at_most(tmp_path: Path, run: int) -> None:
    moment = random.Random(run).uniform(0.3, 2.0)  # noqa: S311 (no secret)
    seen, said = tmp_path / 'seen', tmp_path / 'said'
    drive = ('-m', 'barc_sim.run', 'acc', '--quiet', '--distance', '0', '--bag-dir')
    with process('-c', WITNESS, stdout=seen):
        wait_for(lambda: seen.stat().st_size > 0)
        with process(*drive, str(tmp_path / 'bags'), stdout=said):
            wait_for(lambda: seen.stat().st_size > 1)
            time.sleep(moment)  # it may be killed at any
            killed = time.time_ns()
    path = bag.newest(tmp_path / 'bags')
    assert not (path / 'metadata.yaml').exists()

    recover(path)
    (file,) = path.glob('*.mcap')
    mcap_doctor.check(file)
    kept = states(file)
    assert sorted(kept) == list(range(1, len(kept) + 1))
    lines = [line for line in seen.read_text().splitlines(keepends=True) if line.endswith(']\n')]
    witnessed = [Seen(*json.loads(line)) for line in lines]
    assert witnessed
    for state in witnessed:
        if state.received < killed - MOST_LOST:
            assert state.number in kept
        if state.number in kept:
            assert kept[state.number] == (bytes.fromhex(state.data), state.published)


def states(file: Path) -> dict[int, tuple[bytes, int]]:
    """Return data and publish time of a bag's states, by number."""
    return {
        message.number: (message.data, message.published)
        for message in Contents(file).messages()
        if message.topic.name == '/z_vhcl'
    }
