"""No window opens without a display."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest


@pytest.mark.parametrize('backend', [None, 'tkagg'])
def test_without_a_display_there_is_no_window(backend: str | None) -> None:
    environment = {
        name: value
        for name, value in os.environ.items()
        if name not in {'DISPLAY', 'WAYLAND_DISPLAY', 'MPLBACKEND'}
    }
    script = 'from barc_sim.figures import windows; print(windows.window(str()))'
    result = subprocess.run(
        [sys.executable, '-c', script],
        env=environment | ({'MPLBACKEND': backend} if backend else {}),
        capture_output=True,
        text=True,
        check=True,
    )

    assert (result.stdout.strip(), result.stderr) == ('None', '')
