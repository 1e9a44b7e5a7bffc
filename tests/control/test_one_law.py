"""The law of the lane is in one place: the node, `lap` and the lab's judge all drive with it."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

_SCRIPT = Path(__file__).with_name('lane_drives.py')


def drives(sign: str, folder: Path) -> dict[str, Any]:
    """Return what `lane_drives.py` prints."""
    process = subprocess.run(
        [sys.executable, str(_SCRIPT), sign],
        cwd=folder,
        capture_output=True,
        text=True,
        timeout=110,
        check=False,
    )
    assert process.returncode == 0, process.stderr
    errors: dict[str, Any] = json.loads(process.stdout)
    return errors


def test_a_changed_sign_of_a_lane_law_changes_node_run_and_judge(tmp_path: Path) -> None:
    right = drives('right', tmp_path)
    turned = drives('turned', tmp_path)
    assert right['same']
    assert turned['same']
    for where in ('node', 'lap', 'judge'):
        assert right[where] < 0.3, where
        assert turned[where] > 2.9, where
