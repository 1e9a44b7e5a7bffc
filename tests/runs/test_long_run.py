"""Memory and bag of a long run in lock-step.

`BARC_SIM_SOAK=1 pytest tests/runs/test_long_run.py` drives for an hour of simulated time; without
it, three minutes.
"""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import mcap_doctor
import pytest

from barc_sim.bags import reader as bag

MINUTES = 60 if 'BARC_SIM_SOAK' in os.environ else 3
STEPS = MINUTES * 60 * 50
PROGRAM = Path(__file__).with_name('programs') / 'measure_memory.py'


@pytest.mark.slow
@pytest.mark.timeout(1800)
@pytest.mark.usefixtures('ros_domain')
def test_memory_stays_flat_and_the_bag_is_whole(tmp_path: Path) -> None:
    process = subprocess.run(
        [sys.executable, PROGRAM, str(STEPS), str(tmp_path)],
        stdout=subprocess.PIPE,
        text=True,
        check=True,
        timeout=1800,
    )
    assert int(process.stdout.splitlines()[-1]) < 5e6

    path = bag.newest(tmp_path)
    assert bag.info(path)['lost_messages'] == '0'

    (file,) = path.glob('*.mcap')
    mcap_doctor.check(file)
    assert len(bag.read(path)) >= STEPS
