"""Memory and bag of a long run in lock-step.

`BARC_SIM_SOAK=1 pytest tests/runs/test_long_run.py` drives for an hour of simulated time; without
it, three minutes.
"""

from __future__ import annotations

import os
import subprocess
import sys
from typing import TYPE_CHECKING

import mcap_doctor
import pytest

from barc_sim.bags import reader as bag

if TYPE_CHECKING:
    from pathlib import Path

MINUTES = 60 if 'BARC_SIM_SOAK' in os.environ else 3
STEPS = MINUTES * 60 * 50
PROGRAM = """
import ctypes
import gc
import sys
import time

from barc_sim.runs.car_monitor import CarMonitor
from barc_sim.runs.composition import Run
from barc_sim.run import main

last, folder = int(sys.argv[1]), sys.argv[2]
on_step = CarMonitor.on_step
begin = Run.__init__
runs = []
memory = {}


def keep(run, *args):
    runs.append(run)
    begin(run, *args)


def resident():
    # What a backlog has used and freed is not lost.
    gc.collect()
    ctypes.CDLL(None).malloc_trim(0)
    with open('/proc/self/statm') as statm:
        return int(statm.read().split()[1]) * 4096


def watched(car, t, seen):
    on_step(car, t, seen)
    steps = car.simulator.stepper.states + 1
    if steps in (3000, last):
        # What the recorder has not taken yet is a backlog, and no leak.
        while runs[0].bag.recorder.counts.get('/z_vhcl', 0) < steps - 1:
            time.sleep(0.01)
        memory[steps] = resident()
    if steps == last:
        car.simulator.finish()


CarMonitor.on_step = watched
Run.__init__ = keep
options = ['--road', 'flat', '--distance', '0', '--realtime-factor', 'max', '--bag-dir', folder]
code = main(['acc', '--quiet', *options])
print(memory[last] - memory[3000])
sys.exit(code)
"""


@pytest.mark.slow
@pytest.mark.timeout(1800)
@pytest.mark.usefixtures('ros_domain')
def test_memory_stays_flat_and_the_bag_is_whole(tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, '-c', PROGRAM, str(STEPS), str(tmp_path)],
        stdout=subprocess.PIPE,
        text=True,
        check=True,
        timeout=1800,
    )
    assert int(done.stdout.splitlines()[-1]) < 5e6
    path = bag.newest(tmp_path)
    assert bag.info(path)['lost_messages'] == '0'
    (file,) = path.glob('*.mcap')
    mcap_doctor.check(file)
    assert len(bag.read(path)) >= STEPS
