"""A user's files that are right: they compute what barc_sim's own do, to the last bit."""

from __future__ import annotations

import re
from dataclasses import replace
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any, NamedTuple

from barc_sim.lab.confined.process import JudgedCode
from barc_sim.lab.files import FILES, files_in, find_files
from barc_sim.lab.labs.hills import HILLS
from barc_sim.lab.user_code.code import UserCode
from barc_sim.lab.user_code.folder import BUDGET

if TYPE_CHECKING:
    from collections.abc import Collection

    from barc_sim.lab.grade.grade import Rubric
    from barc_sim.lab.judge import Finding, Settings

TEXTS = Path(__file__).with_name('user_texts')


def user_text(name: str) -> str:
    """Return a text of `user_texts`: a user's file, or a table of changes to one."""
    return (TEXTS / name).read_text(encoding='utf-8')


MODEL = user_text('right_model.py')
CONTROLLER = user_text('right_controller.py')


#: The lab's equations, without the limits of barc_sim's own.
PLAIN_MODEL = user_text('lab_model.py')
PLAIN_CONTROLLER = user_text('lab_controller.py')


LANE = user_text('lane.py')


IDENTIFY = user_text('identify.py')


RACELINE = user_text('raceline.py')


class LocalCode(JudgedCode):
    """User code that is called in this process: nothing stops an endless loop."""

    def __init__(self, code: Any) -> None:  # noqa: ANN401 (a UserCode, or what has its names)
        super().__init__(Path())
        self._code = code

    def has(self, part: str) -> bool:
        """Return whether there is this part of `FILES`."""
        return part in self._code.paths

    def files(self) -> dict[str, bytes]:
        """Return no other files."""
        return {}

    def call(self, do: str, *arguments: Any) -> Any:  # noqa: ANN401 (JSON)
        """Return the result of a request."""
        attribute = getattr(self._code, do)
        return attribute(*arguments) if callable(attribute) else attribute


@cache
def judged_file(
    part: str, name: str, text: str, settings: Settings
) -> tuple[list[Finding], tuple[str, ...]]:
    """Return the findings on one file, called in this process, and what is tolerated in it.

    Each file is judged once, however many programs have it.
    """
    with TemporaryDirectory() as folder:
        path = Path(folder, name)
        path.write_text(text, encoding='utf-8')
        code = LocalCode(UserCode({part: path}, is_judged=True))
        criteria = HILLS.parts[part].labels
        of_file = [each for each in HILLS.judge(code, settings) if each.criterion in criteria]
        assert folder not in ''.join(each.message for each in of_file)
        return of_file, code.tolerated()


def load_folder(folder: Path, parts: Collection[str] = tuple(FILES), **options: Any) -> UserCode:  # noqa: ANN401
    """Load the files in a folder."""
    return UserCode(find_files(folder, parts), **options).load()


def load(path: Path, *, budget: float = BUDGET) -> UserCode:
    """Load the part that the file at `path` has by its name."""
    (part,) = (part for part, name in FILES.items() if name == path.name)
    return UserCode({part: path}, budget=budget).load()


def replaced(text: str, *pairs: tuple[str, str]) -> str:
    """Return `text` with each first string, which must be there, replaced by its second."""
    for old, new in pairs:
        assert old in text, old
        text = text.replace(old, new)
    return text


class Program(NamedTuple):
    """A folder, and what is expected of it."""

    points: float
    line: str  #: a part of the line that the remark names; empty: none is asked for
    sentence: str  #: a part of the remark
    changes: tuple[tuple[str, str], ...] = ()


def read_programs(table: str) -> dict[str, Program]:
    """Return the programs of a table in `user_texts`.

    A program has a line with name, points, place and sentence, then a line for each change.
    """
    programs: dict[str, Program] = {}
    for line in user_text(table).strip().splitlines():
        if not line.startswith(' '):
            name, points, place, sentence = line.split(' | ')
            programs[name] = Program(float(points), place.strip(), sentence)
        else:
            old, new = line.strip().replace('⏎', '\n').split(' -> ')
            changes = (*programs[name].changes, (old, new))
            programs[name] = programs[name]._replace(changes=changes)
    return programs


def points_of(
    program: Program, text: str, rubric: Rubric, folder: Path, criteria: Collection[str] = ()
) -> float:
    """Return the points of a lab's file, in these criteria, and check the remark and its line."""
    (name,) = rubric.lab.handout.files.values()
    (folder / name).write_text(text, encoding='utf-8')
    criteria = criteria or rubric.points
    code = LocalCode(UserCode(files_in(folder), is_judged=True))
    findings = rubric.lab.judge(code, replace(rubric.settings, criteria=criteria))
    assert [each.criterion for each in findings] == [*criteria]
    remarks = '\n'.join(each.message for each in findings)
    before, sentence, _ = remarks.partition(program.sentence)
    assert sentence, remarks
    if program.line:
        number = int(re.findall(rf'{name}, line (\d+)', before.splitlines()[-1])[-1])
        assert text.splitlines()[number - 1].strip().startswith(program.line)
    return sum(rubric.points_for(each) for each in findings if not each.open)
