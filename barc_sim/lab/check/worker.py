"""Judges a folder in a separate process, so that user code cannot hang or end the command."""

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
from barc_sim.lab.check.findings import CRITERIA, Finding
from barc_sim.lab.check.judging import findings

if TYPE_CHECKING:
    from collections.abc import Callable
    from multiprocessing.connection import Connection
    from pathlib import Path

    from barc_sim.lab.check.stretches import Gains

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
        return Printed(self._text, self._dropped)


@dataclass(frozen=True)
class Report:
    """The findings on a folder, and the text that its code printed."""

    findings: list[Finding]  #: of every criterion
    printed: Printed


@dataclass(frozen=True)
class _Parts:
    model: Callable[..., Any] | None
    controller: Callable[..., Any] | None


def judge_folder(
    folder: Path,
    seed: int,
    gains: Gains,
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
    """
    _check_there(folder)
    # A new interpreter, without the imports and patches of this process.
    context = multiprocessing.get_context('spawn')
    ours, theirs = context.Pipe(duplex=False)
    process = context.Process(target=_work, args=(theirs, folder, seed, gains, budget), daemon=True)
    process.start()
    theirs.close()
    end = time.monotonic() + deadline
    found: list[Finding] = []
    printed = Printed()
    lost = f'no result within {deadline:g} s: is there an endless loop, or a sleep?'
    try:
        while len(found) < len(CRITERIA) and ours.poll(max(end - time.monotonic(), 0.0)):
            finding, printed = ours.recv()
            found.append(finding)
    except EOFError:
        process.join()
        lost = f'the code ended the whole process, with exit code {process.exitcode}'
    finally:
        process.kill()
        process.join()
        ours.close()
    found += [Finding(name, 0.0, lost) for name in CRITERIA[len(found) :]]
    return Report(found, printed)


def _check_there(folder: Path) -> None:
    from barc_sim.lab.user_code.loading import FILES  # noqa: PLC0415 (grade does without)

    if not folder.is_dir():
        raise UserError(
            f'there is no folder {str(folder)!r}: barc new {folder.name or "my_lab"} writes one'
        )
    names = [FILES['model'], FILES['controller']]
    if not any((folder / name).exists() for name in names):
        raise UserError(f'the folder {str(folder)!r} has no {" and no ".join(names)} to check')


def _work(connection: Connection, folder: Path, seed: int, gains: Gains, budget: float) -> None:
    printer = _Printer()
    with redirect_stdout(printer), redirect_stderr(printer):
        code = LocalCode(
            _Parts(
                model=_load(folder, 'model', budget), controller=_load(folder, 'controller', budget)
            )
        )
        for finding in findings(code, seed, gains):
            connection.send((finding, printer.printed()))


def _load(folder: Path, part: str, budget: float) -> Callable[..., Any] | None:
    """Return a part of the folder; if it cannot be loaded, each call raises that error."""
    from barc_sim.lab.user_code.loading import FILES, load_folder  # noqa: PLC0415 (as above)

    if not (folder / FILES[part]).exists():
        return None
    try:
        lab = load_folder(folder, [part], budget=budget)
    except UserError as error:
        return partial(_raise, error)
    loaded: Callable[..., Any] | None = getattr(lab, part)
    return loaded


def _raise(error: UserError, *_: object, **__: object) -> None:
    raise error
