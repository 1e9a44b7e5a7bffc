"""Memory and bag of a long run in lock-step.

`BARC_SIM_SOAK=1 pytest tests/test_long_run.py` drives for an hour of simulated time; without it,
three minutes.
"""

from __future__ import annotations

import os
import subprocess
import sys
from typing import TYPE_CHECKING

import mcap_doctor
import pytest

from barc_sim import bag

if TYPE_CHECKING:
    from pathlib import Path

MINUTES = 60 if 'BARC_SIM_SOAK' in os.environ else 3
STEPS = MINUTES * 60 * 50
PROGRAM = """
import sys
from argparse import Namespace
from pathlib import Path

from barc_sim.cruise_control import CruiseControl
from barc_sim.executor import QuickExecutor
from barc_sim.process import ros
from barc_sim.signals import StopSignals


def memory():
    with open('/proc/self/statm') as statm:
        return int(statm.read().split()[1]) * 4096


class Watched(CruiseControl):
    steps = 0

    def on_step(self, t, seen):
        super().on_step(t, seen)
        self.steps += 1
        if self.steps == 3000:
            self.after_a_minute = memory()
        if self.steps == int(sys.argv[1]):
            self.finish()


options = Namespace(
    **dict.fromkeys(('speed', 'kp', 'ki', 'kd', 'seed', 'clock')),
    road='flat', distance=0.0, realtime_factor=0.0, no_bag=False, bag_dir=Path(sys.argv[2]),
    quiet=True,
)
with ros([]), StopSignals() as stop:
    run = Watched(options, [])
    run.spin(stop, QuickExecutor(num_threads=2))
    print(memory() - run.after_a_minute)
    run.close()
"""


@pytest.mark.timeout(1800)
@pytest.mark.usefixtures('ros_domain')
def test_memory_stays_flat_and_the_bag_is_whole(tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, '-c', PROGRAM, str(STEPS), str(tmp_path)],
        env={**os.environ, 'PYTHONPATH': os.pathsep.join(sys.path)},
        stdout=subprocess.PIPE,
        text=True,
        check=True,
        timeout=1800,
    )
    assert int(done.stdout) < 5e6
    path = bag.newest(tmp_path)
    assert bag.info(path)['lost_messages'] == '0'
    (file,) = path.glob('*.mcap')
    mcap_doctor.check(file)
    assert len(bag.read(path)) >= STEPS
