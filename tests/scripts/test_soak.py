"""What must hold under faults, in the short forms of `scripts/soak`.

`BARC_SIM_SOAK=1 pytest tests/scripts/test_soak.py` goes through the long ones.
"""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip('rclpy')

import barc_sim

ROOT = Path(barc_sim.__file__).parents[1]
LENGTH = [] if 'BARC_SIM_SOAK' in os.environ else ['--short']


@pytest.mark.slow
@pytest.mark.timeout(1800)
@pytest.mark.usefixtures('ros_domain')
@pytest.mark.parametrize('ordeal', ['flood', 'kill', 'reset', 'signals', 'split'])
def test_a_run_keeps_its_bounds_under_faults(ordeal: str) -> None:
    process = subprocess.run(
        [sys.executable, str(ROOT / 'scripts' / 'soaking' / '_soak.py'), ordeal, *LENGTH],
        env=os.environ | {'PYTHONPATH': str(ROOT)},
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        check=False,
    )
    sys.stderr.write(process.stderr)  # shown where it fails

    assert process.returncode == 0, process.stdout
    assert 'BROKEN' not in process.stdout
