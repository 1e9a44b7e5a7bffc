"""A folder with a lab, bags and a class, in which the commands of the fuzzers run."""

from __future__ import annotations

import os
import shutil
import tempfile
import time
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

from _command import run

RUN = 'acc -q --distance 5 --realtime-factor max'
BAG = 'bags/run'
KILLED = 'bags/killed'  #: of a run that was killed
#: The name of a new bag, so that two runs make the same.
_DATE = '2026-01-02_03-04-05'
_SUBMISSION = Path(__file__).parents[1] / 'submission'
_FILES = {
    'road.csv': 'start_m,grade_deg\n0,0\n20,10\n',
    'values.yaml': 'vehicle_simulator:\n  ros__parameters:\n    mass: 1000.0\n',
    'rubric.yaml': 'criteria:\n  model.x: 10\n  loop.lab_road: 10\n',
    'film.mp4': 'a film\n',
}


class Place(NamedTuple):
    """A folder to run in, and what lies outside of it."""

    inside: Path
    outside: Path

    @property
    def folder(self) -> Path:
        """The folder of both."""
        return self.inside.parent


@cache
def original() -> Place:
    """Return a place with a bag, one of a killed run, a lab, a class and a road."""
    folder = Path(tempfile.mkdtemp(prefix='fuzz_links_'))
    place = Place(folder / 'inside', folder / 'outside')
    _make_inside(place.inside)
    (place.outside / 'folder').mkdir(parents=True)
    for path in (place.outside / 'file', place.outside / 'folder' / 'file'):
        path.write_text('outside\n', encoding='ascii')
    return place


def _make_inside(inside: Path) -> None:
    for name in ('out', 'home', 'bags', 'class'):
        (inside / name).mkdir(parents=True)
    for name, text in _FILES.items():
        (inside / name).write_text(text, encoding='ascii')
    for command in ('new lab', f'{RUN} --engine local --bag-dir new_bags'):
        end = run(command.split(), inside, prepare_process)
        if end.code:
            raise RuntimeError(end.text)

    shutil.copytree(_SUBMISSION, inside / 'lab', dirs_exist_ok=True)
    shutil.copytree(inside / 'lab', inside / 'class' / 'ada')
    for name, form in (('bob', 'zip'), ('eve', 'gztar')):
        shutil.make_archive(str(inside / 'class' / name), form, inside / 'lab')

    (bag,) = (inside / 'new_bags').iterdir()
    bag.replace(inside / BAG)
    (inside / 'new_bags').rmdir()
    shutil.copytree(inside / BAG, inside / KILLED)
    (file,) = (inside / KILLED).glob('*.mcap')
    os.truncate(file, file.stat().st_size // 2)


def copy_of_original(folder: Path) -> Place:
    """Return a copy, in `folder`, of the original place."""
    shutil.copytree(original().folder, folder, dirs_exist_ok=True)
    return Place(folder / 'inside', folder / 'outside')


def prepare_process() -> None:
    """Prepare the process of a command: its home, and the date in the names of its bags."""
    os.environ['HOME'] = str(Path.cwd() / 'home')
    os.environ['BARC_SIM_NO_BROWSER'] = '1'
    strftime = time.strftime

    def strftime_of_one_day(form: str, *args: Any) -> str:  # noqa: ANN401 (of strftime)
        if form == '%Y-%m-%d_%H-%M-%S':
            return _DATE
        return strftime(form, *args)

    time.strftime = strftime_of_one_day
