"""Runs killed at any moment: what their bags still hold, against what a subscriber saw.

`BARC_SIM_SOAK=1 pytest tests/runs/test_kill.py` kills 100 runs, and holds them to 0.25 s: quiet
machines can. Otherwise, what is in the bag at one moment has to be there after the kill.
"""

from __future__ import annotations

import os
import random
import time
from typing import TYPE_CHECKING

import pytest

pytest.importorskip('rclpy')

import mcap_doctor
from barc_interfaces.msg import ZDynBkMdl
from command_line import started, wait_for
from rclpy.node import Node

from barc_sim.bags import reader as bag
from barc_sim.bags.contents import Contents
from barc_sim.bags.recovery import recover
from barc_sim.ros.recording.polled import Taker

if TYPE_CHECKING:
    from pathlib import Path

    from rclpy.context import Context

SOAK = 'BARC_SIM_SOAK' in os.environ
RUNS = 100 if SOAK else 4
PARTS = [pytest.param(run, marks=[pytest.mark.slow] * (run > 0)) for run in range(RUNS)]
MOST_LOST = 250_000_000  #: [ns] on a quiet machine


@pytest.mark.timeout(1800)
@pytest.mark.parametrize('run', PARTS)
def test_the_bag_of_a_killed_run_has_all_states_that_were_written(
    ros: Context, tmp_path: Path, run: int
) -> None:
    moment = random.Random(run).uniform(0.3, 2.0)  # noqa: S311 (no secret)
    node = Node('witness', context=ros)
    subscription = node.create_subscription(ZDynBkMdl, 'z_vhcl', lambda _: None, 10_000, raw=True)
    taker, received_states = Taker(), []

    def is_seen() -> bool:
        received_states.extend(taker.take(subscription, 10_000))
        return bool(received_states)

    bags = tmp_path / 'bags'
    with started('acc', '--quiet', '--distance', '0', '--bag-dir', str(bags)):
        wait_for(is_seen)
        if not SOAK:
            # On a busy machine, a time says nothing: what is written by now stays.
            latest = received_states[-1][3]
            wait_for(lambda: latest in written_states(bags))
        time.sleep(moment)  # it may be killed at any
        killed = time.time_ns()
    is_seen()
    taker.close()
    node.destroy_node()
    path = bag.newest(bags)
    assert not (path / 'metadata.yaml').exists()

    recover(path, bags / 'whole')
    file = bags / 'whole' / 'whole_0.mcap'
    mcap_doctor.check(file)
    recovered = states(file)
    assert sorted(recovered) == list(range(1, len(recovered) + 1))

    for data, published, received, number, _ in received_states:
        if received < killed - MOST_LOST if SOAK else number <= latest:
            assert number in recovered
        if number in recovered:
            assert recovered[number] == (data, published)


def written_states(bags: Path) -> dict[int, tuple[bytes, int]]:
    """Return the states in the bag of a run that goes on."""
    files = [*bags.glob('*/*.mcap')]
    return states(files[0]) if files else {}


def states(file: Path) -> dict[int, tuple[bytes, int]]:
    """Return data and publish time of a bag's states, by number."""
    return {
        message.number: (message.data, message.published)
        for message in Contents(file).messages()
        if message.topic.name == '/z_vhcl'
    }
