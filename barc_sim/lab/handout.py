"""The lab as data: what a student writes, and what is handed out for it.

The criteria of its points stand in `hills/lab.py`, and the points in `grade/rubrics/`.
"""

from __future__ import annotations

from importlib import resources

#: The file of each part that is loaded and judged.
FILES = {'model': 'bike_model.py', 'controller': 'controller.py', 'relay': 'relay.py'}
#: The script of Task 3, which is run as it is.
COMPOSE = 'compose.py'
#: The names of the rubrics.
RUBRICS = ('lab', 'strict', 'extended')
_TEMPLATES = resources.files('barc_sim.lab') / 'templates'


def templates() -> dict[str, bytes]:
    """Return the files that a student starts with, by name."""
    names = ('README.md', *FILES.values(), COMPOSE)
    return {name: (_TEMPLATES / name).read_bytes() for name in names}
