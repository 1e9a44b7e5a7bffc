"""Judges a folder in a process of its own, so that nothing in it can hang or end the command."""

from __future__ import annotations

import io
import multiprocessing
import time
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

from barc_sim.errors import UserError
from barc_sim.lab.check.code import LocalCode
from barc_sim.lab.check.finding import CRITERIA, Finding
from barc_sim.lab.check.judging import findings

if TYPE_CHECKING:
    from collections.abc import Callable
    from multiprocessing.connection import Connection
    from pathlib import Path

    from barc_sim.lab.check.stretches import Gains

#: [s] A call of user code may take so long; it is ended, and told of, where it is Python.
CALL_BUDGET = 0.5
#: [s] Where that does not end it (a sleep, a loop in C), the process is.
DEADLINE = 45.0
_CHARACTERS = 400  #: of what is printed, kept


@dataclass(frozen=True)
class Prints:
    """The beginning of what user code prints."""

    text: str = ''
    dropped: int = 0  #: lines beyond that


class _Printer(io.TextIOBase):
    """Takes what is printed, however much it is."""

    def __init__(self) -> None:
        self._text = ''
        self._dropped = 0

    def write(self, text: str, /) -> int:
        """Keep what there is room for, and count the lines that are not."""
        room = max(_CHARACTERS - len(self._text), 0)
        self._text += text[:room]
        self._dropped += text[room:].count('\n')
        return len(text)

    def prints(self) -> Prints:
        return Prints(self._text, self._dropped)


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
    """Return what is found of a user's `folder`, at the latest after `deadline` [s].

    Raises
    ------
    UserError
        where the folder, or anything to judge in it, is not there.
    """
    _check_there(folder)
    # A fresh interpreter: what this process has imported or patched is not the user's.
    context = multiprocessing.get_context('spawn')
    ours, theirs = context.Pipe(duplex=False)
    process = context.Process(target=_work, args=(theirs, folder, seed, gains), daemon=True)
    process.start()
    theirs.close()
    end = time.monotonic() + deadline
    found: list[Finding] = []
    prints = Prints()
    lost = f'no answer within {deadline:g} s: is there a loop that does not end, or a sleep?'
    try:
        while len(found) < len(CRITERIA) and ours.poll(max(end - time.monotonic(), 0.0)):
            finding, prints = ours.recv()
            found.append(finding)
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
    from barc_sim.lab.user_code.loading import FILES  # noqa: PLC0415 (needed by who loads, not by grade)

    if not folder.is_dir():
        raise UserError(
            f'there is no folder {str(folder)!r}: python -m barc_sim new {folder.name or "my_lab"} '
            'writes one'
        )
    names = [FILES['model'], FILES['controller']]
    if not any((folder / name).exists() for name in names):
        raise UserError(f'the folder {str(folder)!r} has no {" and no ".join(names)} to check')


def _work(connection: Connection, folder: Path, seed: int, gains: Gains) -> None:
    printer = _Printer()
    with redirect_stdout(printer), redirect_stderr(printer):
        code = LocalCode(
            _Parts(model=_load(folder, 'model'), controller=_load(folder, 'controller'))
        )
        for finding in findings(code, seed, gains):
            connection.send((finding, printer.prints()))


def _load(folder: Path, part: str) -> Callable[..., Any] | None:
    """Return a part of the folder; one that can't be loaded says so at each call."""
    from barc_sim.lab.user_code.loading import FILES, load_folder  # noqa: PLC0415 (as above)

    if not (folder / FILES[part]).exists():
        return None
    try:
        lab = load_folder(folder, [part], budget=CALL_BUDGET)
    except UserError as error:
        return partial(_raise, error)
    loaded: Callable[..., Any] | None = getattr(lab, part)
    return loaded


def _raise(error: UserError, *_: object, **__: object) -> None:
    raise error
