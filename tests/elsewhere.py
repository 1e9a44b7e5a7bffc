"""The environment of a Python that lacks ROS, and what only Linux has (`other_system/`)."""

from __future__ import annotations

import os
from pathlib import Path

import barc_sim

_FOLDERS = (Path(__file__).parent / 'other_system', Path(barc_sim.__file__).parents[1])
#: A text file that is opened in the system's encoding is an error; output can be ASCII alone.
ELSEWHERE = {
    'PYTHONPATH': os.pathsep.join(map(str, _FOLDERS)),
    'PYTHONWARNDEFAULTENCODING': '1',
    'PYTHONIOENCODING': 'ascii',
    'MPLBACKEND': 'agg',
}
