"""Points and comments that a person enters, in a file beside a submission's report.

`grade` writes the file once, with the computed points as comments, and then only reads it. It is
written again only while nothing is entered in it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import yaml

from barc_sim.cli.files import read_regular
from barc_sim.errors import UserError, one_line
from barc_sim.lab.handout import BY_HAND

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from barc_sim.lab.grade.rubric import Rubric

_MAX_BYTES, _MAX_COMMENT = 1 << 18, 2000


class ByHand(NamedTuple):
    """What a person has entered for a submission."""

    points: Mapping[str, tuple[float, str]] = {}  #: and a comment on them, by criterion
    comment: str = ''  #: on all of it

    def __bool__(self) -> bool:
        """Return whether anything is entered."""
        return bool(self.points or self.comment)


def read(folder: Path, rubric: Rubric) -> ByHand:
    """Return what is entered in the file in `folder`; nothing without one; or a UserError."""
    path = folder / BY_HAND
    try:
        found = yaml.safe_load(read_regular(path, _MAX_BYTES)) or {}
    except FileNotFoundError:
        return ByHand()
    except (OSError, UnicodeDecodeError, yaml.YAMLError) as error:
        raise UserError(f'{str(path)!r} cannot be read: {one_line(str(error), 200)}') from None
    points = (found.get('points') or {}) if isinstance(found, dict) else None
    if not isinstance(points, dict):
        raise UserError(f'{str(path)!r} has no comment and points: expected lines "key: value"')
    entered = {}
    for name, value in points.items():
        if name not in rubric.points:
            raise UserError(
                f'{str(path)!r}: the rubric has no criterion {name!r}: delete the line, or give '
                'the rubric that has it'
            )
        if value is not None:
            entered[name] = _points(path, name, value)
    return ByHand(entered, one_line(str(found.get('comment') or ''), _MAX_COMMENT))


def _points(path: Path, name: str, value: Any) -> tuple[float, str]:  # noqa: ANN401 (YAML)
    number, _, comment = str(value).partition(' ')
    try:
        points = float(number)
    except ValueError:
        points = -1.0
    if not 0.0 <= points < float('inf'):
        raise UserError(
            f'{str(path)!r}: {name} is {value!r}: expected points such as 4.5, and after a space a '
            'comment if you like'
        )
    return points, one_line(comment, _MAX_COMMENT)
