"""The lab as data: what a student writes, and what is handed out for it.

The criteria of its points stand in `hills/lab.py`, and the points in `grade/rubrics/`.
"""

from __future__ import annotations

from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Collection

#: The file of each part that is loaded and judged.
FILES = {'model': 'bike_model.py', 'controller': 'controller.py', 'relay': 'relay.py'}
#: The script of Task 3, which is run as it is.
COMPOSE = 'compose.py'
#: The file of a person's points and comments, beside a report.
BY_HAND = 'by_hand.yaml'
#: The names of the rubrics.
RUBRICS = ('lab', 'strict', 'extended')
_TEMPLATES = resources.files('barc_sim.lab') / 'templates'


def templates() -> dict[str, bytes]:
    """Return the files that a student starts with, by name."""
    names = ('README.md', *FILES.values(), COMPOSE)
    return {name: (_TEMPLATES / name).read_bytes() for name in names}


def files_in(folder: Path, parts: Collection[str] = tuple(FILES)) -> dict[str, Path]:
    """Return the files of `parts` in `folder`, by part, see `find_name`."""
    names = [file.name for file in folder.glob('*.py') if file.exists()]
    return {part: folder / name for part in parts if (name := find_name(names, part))}


def find_name(names: Collection[str], part: str) -> str | None:
    """Return the name of a part's file among `names`: its own, or the only one of a similar name.

    Similar are `Bike_Model.py`, `bike_model_final(1).py` and `my_bike_model.py`.
    """
    if FILES[part] in names:
        return FILES[part]
    stem = _letters(Path(FILES[part]).stem)
    letters = {name: _letters(name[:-3]) for name in names if name.endswith('.py')}
    similar = [name for name, own in letters.items() if own.startswith(stem) or own.endswith(stem)]
    return similar[0] if len(similar) == 1 else None


def _letters(name: str) -> str:
    return ''.join(filter(str.isalpha, name.lower()))
