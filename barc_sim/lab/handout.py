"""The labs as data: what a student writes in each, what is handed out for it, the pages of reports.

How the parts are judged stands in `labs/`, and the points in `grade/rubrics/`.
"""

from __future__ import annotations

from base64 import b64encode
from functools import cache
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from barc_sim import __version__

if TYPE_CHECKING:
    from collections.abc import Collection, Mapping

    from jinja2 import Environment

#: The script of Task 3 of the hills lab, which is run as it is.
COMPOSE = 'compose.py'
#: The file of a person's points and comments, beside a report.
BY_HAND = 'by_hand.yaml'


class Handout(NamedTuple):
    """What a lab hands out, and what it wants back."""

    folder: str  #: of its templates
    files: Mapping[str, str]  #: that are loaded and judged, by part
    rubric: str  #: its name
    drive: str  #: the command that drives with a folder, less that folder
    others: tuple[str, ...] = ()  #: more files to write

    @property
    def written(self) -> str:
        """The names of the files to write."""
        return ', '.join((*self.files.values(), *self.others))

    def templates(self) -> dict[str, bytes]:
        """Return the files that a student starts with, by name."""
        folder = resources.files('barc_sim.lab') / 'templates' / self.folder
        names = ('README.md', *self.files.values(), *self.others)
        return {name: (folder / name).read_bytes() for name in names}


HILLS = Handout(
    folder='hills',
    files={'model': 'bike_model.py', 'controller': 'controller.py', 'relay': 'relay.py'},
    rubric='lab',
    drive='acc --lab',
    others=(COMPOSE,),
)
LANE = Handout(
    folder='lane',
    files={'lane': 'lane.py'},
    rubric='lane',
    drive='acc --track L --speed 6 --laps 3 --dynamics dynamic --lab',
)
RACELINE = Handout(
    folder='raceline',
    files={'raceline': 'raceline.py'},
    rubric='raceline',
    drive='acc --track L --speed-profile 3.5 2 --speed 12 --laps 3 --dynamics dynamic --lab',
)
IDENTIFY = Handout(
    folder='identify',
    files={'identify': 'identify.py'},
    rubric='identify',
    drive='acc --road flat --distance 0 --lab',
)
#: By the word of `barc new --lab`.
HANDOUTS = {'hills': HILLS, '3': LANE, '4': RACELINE, '5': IDENTIFY}
#: The file of each part of any lab.
FILES = {part: name for each in HANDOUTS.values() for part, name in each.files.items()}
#: The names of the rubrics.
RUBRICS = tuple(each.rubric for each in HANDOUTS.values())


def handout_of(parts: Collection[str]) -> Handout:
    """Return the lab of a folder with these parts: that of which the most is there."""
    return max(
        HANDOUTS.values(),
        key=lambda each: len(each.files.keys() & set(parts)) / len(each.files),
    )


def names_of(names: Collection[str], parts: Collection[str] = tuple(FILES)) -> dict[str, str]:
    """Return the names of the files of `parts` among `names`, by part, see `find_name`."""
    return {part: name for part in parts if (name := find_name(names, part))}


def files_in(folder: Path, parts: Collection[str] = tuple(FILES)) -> dict[str, Path]:
    """Return the files of `parts` in `folder`, by part, see `find_name`."""
    names = [file.name for file in folder.glob('*.py') if file.exists()]
    return {part: folder / name for part, name in names_of(names, parts).items()}


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


def render(page: str, **values: object) -> str:
    """Return the page of that name in `pages/` as HTML without links; every value is escaped."""
    return _environment().get_template(f'{page}.html').render(version=__version__, **values)


def data_url(kind: str, data: bytes) -> str:
    """Return an image of the MIME type `kind` as a URL that contains it."""
    return f'data:{kind};base64,{b64encode(data).decode()}'


@cache
def _environment() -> Environment:
    from jinja2 import Environment, PackageLoader, StrictUndefined  # noqa: PLC0415 (not confined)

    return Environment(
        loader=PackageLoader('barc_sim.lab', 'pages'),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
