"""Submissions in the manner of students, made from one ROS 1 script."""

from __future__ import annotations

from typing import NamedTuple

from user_files import replaced, user_text

MODEL = user_text('ros_1_model.py')

CONTROLLER = user_text('ros_1_controller.py')


class Work(NamedTuple):
    """A submission, and what is expected of it."""

    model: str
    controller: str
    points: float
    sentence: str  #: in the report
    files: tuple[str, str] = ('bike_model.py', 'controller.py')


def _read(table: str) -> dict[str, Work]:
    """Return the works of a table: name, points and sentence, then what is replaced by what."""
    works: dict[str, Work] = {}
    for line in table.strip().splitlines():
        if not line.startswith(' '):
            name, points, sentence = line.split(' | ')
            work = Work(MODEL, CONTROLLER, float(points), sentence)
        else:
            old, new = line.strip().split(' -> ')
            change = (old, new.replace('⏎', '\n        '))
            part = 'model' if old in work.model else 'controller'
            work = work._replace(**{part: replaced(getattr(work, part), change)})
        works[name] = work
    return works


WORKS = _read(user_text('ros_1_works.txt'))
WORKS['names of files'] = WORKS['no limit of the sum']._replace(
    sentence='Bike_Model.py is taken as bike_model.py',
    files=('Bike_Model.py', 'controller_final(1).py'),
)
