"""Judges a folder in a separate process, so that user code cannot hang or end the command."""

from __future__ import annotations

import io
import multiprocessing
import time
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, NoReturn

from barc_sim.errors import UserError
from barc_sim.lab.check.code import LocalCode
from barc_sim.lab.check.findings import CRITERIA, Finding
from barc_sim.lab.check.judging import Settings, findings, gains_used
from barc_sim.lab.user_code.call import without_addresses
from barc_sim.lab.user_code.loading import FILES, UserCode, find_file, find_files, load_folder

if TYPE_CHECKING:
    from multiprocessing.connection import Connection
    from pathlib import Path

    from barc_sim.lab.user_code.gains import ChosenGains

#: [s] Limit for one call of user code; a call in Python is ended then, with a message.
CALL_BUDGET = 0.5
#: [s] Limit for the process, which ends a sleep or a loop in C.
DEADLINE = 45.0
_CHARACTERS = 400  #: kept of the printed text


@dataclass(frozen=True)
class Printed:
    """The first characters that user code prints."""

    text: str = ''
    dropped: int = 0  #: further lines


class _Printer(io.TextIOBase):
    """Receives the printed text; keeps only its beginning."""

    def __init__(self) -> None:
        self._text = ''
        self._dropped = 0

    def write(self, text: str, /) -> int:
        """Keep the text that fits, and count further lines."""
        room = max(_CHARACTERS - len(self._text), 0)
        self._text += text[:room]
        self._dropped += text[room:].count('\n')
        return len(text)

    def printed(self) -> Printed:
        return Printed(without_addresses(self._text), self._dropped)


@dataclass(frozen=True)
class Report:
    """The findings on a folder, and the text that its code printed."""

    findings: list[Finding]  #: of each criterion asked for
    printed: Printed
    gains: ChosenGains | None = None  #: that drove the roads
    tolerated: tuple[str, ...] = ()  #: a phrase each


def judge_folder(
    folder: Path,
    settings: Settings | None = None,
    *,
    budget: float = CALL_BUDGET,
    deadline: float = DEADLINE,
) -> Report:
    """Return the findings on a user's `folder`, after `deadline` [s] at the latest.

    A call of its code may take `budget` [s].

    Raises
    ------
    UserError
        if the folder is missing, or has no file to judge.

    Examples
    --------
    >>> from barc_sim.commands.new import write
    >>> write(Path('my_lab'))
    >>> report = judge_folder(Path('my_lab'))
    >>> report.findings[0].score
    0.0
    """
    find_files(folder)
    return judge_files(folder, settings or Settings(), budget=budget, deadline=deadline)


def judge_files(
    folder: Path, settings: Settings, *, budget: float = CALL_BUDGET, deadline: float = DEADLINE
) -> Report:
    """Return the findings on the files in `folder`, as `judge_folder` does; there may be none."""
    # A new interpreter, without the imports and patches of this process.
    context = multiprocessing.get_context('spawn')
    ours, theirs = context.Pipe(duplex=False)
    process = context.Process(target=_work, args=(theirs, folder, settings, budget), daemon=True)
    process.start()
    theirs.close()
    end = time.monotonic() + deadline
    found: list[Finding] = []
    wanted = [name for name in CRITERIA if name in settings.criteria]
    report = Report([], Printed())
    lost = f'no result within {deadline:g} s: is there an endless loop, or a sleep?'
    try:
        while len(found) < len(wanted) and ours.poll(max(end - time.monotonic(), 0.0)):
            report = ours.recv()
            found += report.findings
    except EOFError:
        process.join()
        lost = f'the code ended the whole process, with exit code {process.exitcode}'
    finally:
        process.kill()
        process.join()
        ours.close()
    known = {finding.criterion for finding in found}
    found += [Finding(name, 0.0, lost) for name in wanted if name not in known]
    found.sort(key=lambda finding: wanted.index(finding.criterion))
    return replace(report, findings=found)


def _work(connection: Connection, folder: Path, settings: Settings, budget: float) -> None:
    printer = _Printer()
    with redirect_stdout(printer), redirect_stderr(printer):
        user_code = load_parts(folder, budget)
        code = LocalCode(user_code)
        gains = gains_used(code, settings) if code.has('controller') else None
        for finding in findings(code, settings):
            report = Report([finding], printer.printed(), gains, user_code.tolerated)
            connection.send(report)


def load_parts(folder: Path, budget: float | None) -> UserCode:
    """Return the parts of a folder; those that cannot be loaded raise their error at each call."""
    parts: dict[str, Any] = {}
    tolerated: dict[str, None] = {}
    for part in FILES:
        if find_file(folder, part):
            try:
                lab = load_folder(folder, [part], budget=budget, packages=False)
            except UserError as error:
                parts[part] = _Failing(error)
            else:
                parts[part] = getattr(lab, part)
                tolerated |= dict.fromkeys(lab.tolerated)
    return UserCode(**parts, tolerated=tuple(tolerated))


class _Failing:
    """Takes the place of a part; each call raises the error."""

    def __init__(self, error: UserError) -> None:
        self._error = error

    def __call__(self, *_: object, **__: object) -> NoReturn:
        raise self._error

    commands = __call__
