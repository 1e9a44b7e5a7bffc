"""Judges a folder in a process of its own, so that nothing in it can hang or end the command."""

from __future__ import annotations

import multiprocessing
import time
from dataclasses import dataclass, field
from functools import partial
from typing import TYPE_CHECKING, Any

from barc_sim.checking.code import LocalCode
from barc_sim.checking.finding import CRITERIA, Finding
from barc_sim.checking.judging import findings
from barc_sim.errors import UserError

if TYPE_CHECKING:
    from collections.abc import Callable
    from multiprocessing.connection import Connection
    from pathlib import Path

    from barc_sim.checking.stretches import Gains

#: [s] A call of the student's code may take so long; it is ended, and told of, where it is Python.
CALL_BUDGET = 0.5
#: [s] Where that does not end it (a sleep, a loop in C), the process is.
DEADLINE = 45.0
_LINES, _CHARACTERS = 5, 1000  #: of what is printed, kept


@dataclass
class Prints:
    """The beginning of what the student's code prints."""

    lines: list[str] = field(default_factory=list)
    dropped: int = 0  #: prints beyond those

    def add(self, text: str) -> None:
        """Take one print."""
        room = _CHARACTERS - sum(map(len, self.lines))
        if len(self.lines) < _LINES and room > 0:
            self.lines.append(text.rstrip('\n')[:room])
        elif text.strip():
            self.dropped += 1


@dataclass(frozen=True)
class Report:
    """All that there is to tell of a folder."""

    findings: list[Finding]  #: of every criterion
    prints: Prints


@dataclass(frozen=True)
class _Parts:
    model: Callable[..., Any] | None
    controller: Callable[..., Any] | None


def judge_folder(folder: Path, seed: int, gains: Gains, *, deadline: float = DEADLINE) -> Report:
    """Return what is found of a student's `folder`, at the latest after `deadline` [s].

    Raises
    ------
    UserError
        where the folder, or anything to judge in it, is not there.
    """
    _check_there(folder)
    # A fresh interpreter: what this process has imported or patched is not the student's.
    context = multiprocessing.get_context('spawn')
    ours, theirs = context.Pipe(duplex=False)
    process = context.Process(target=_work, args=(theirs, folder, seed, gains), daemon=True)
    process.start()
    theirs.close()
    end = time.monotonic() + deadline
    found: list[Finding] = []
    prints = Prints()
    lost = 'the code has not come back'
    try:
        while True:
            if not ours.poll(max(end - time.monotonic(), 0.0)):
                lost = (
                    f'no answer within {deadline:g} s: is there a loop that does not end, or a '
                    'sleep?'
                )
                break
            message = ours.recv()
            if isinstance(message, Finding):
                found.append(message)
            else:
                prints = message
                break
    except EOFError:
        process.join()
        lost = f'the code ended the whole process, with exit code {process.exitcode}'
    finally:
        process.kill()
        process.join()
        ours.close()
    found += [Finding(name, 0.0, lost) for name in CRITERIA[len(found) :]]
    return Report(found, prints)


def _check_there(folder: Path) -> None:
    from barc_sim.student.code import FILES  # noqa: PLC0415 (needed by who loads, not by grade)

    if not folder.is_dir():
        raise UserError(
            f'there is no folder {str(folder)!r}: python -m barc_sim.new {folder.name or "my_lab"} '
            'writes one'
        )
    names = [FILES['model'], FILES['controller']]
    if not any((folder / name).exists() for name in names):
        raise UserError(f'the folder {str(folder)!r} has no {" and no ".join(names)} to check')


def _work(connection: Connection, folder: Path, seed: int, gains: Gains) -> None:
    prints = Prints()
    code = LocalCode(
        _Parts(
            model=_load(folder, 'model', prints.add),
            controller=_load(folder, 'controller', prints.add),
        )
    )
    for finding in findings(code, seed, gains):
        connection.send(finding)
    connection.send(prints)


def _load(folder: Path, part: str, output: Callable[[str], None]) -> Callable[..., Any] | None:
    """Return a part of the folder; one that can't be loaded says so at each call."""
    from barc_sim.student.code import FILES, load_lab  # noqa: PLC0415 (as above)

    if not (folder / FILES[part]).exists():
        return None
    try:
        lab = load_lab(folder, [part], budget=CALL_BUDGET, output=output)
    except UserError as error:
        return partial(_raise, error)
    loaded: Callable[..., Any] | None = getattr(lab, part)
    return loaded


def _raise(error: UserError, *_: object, **__: object) -> None:
    raise error
