"""Judges a user's model, controller and relay by the criteria of a rubric.

`judge` calls the code where it is told to; `judge_folder` loads a folder in a separate process, so
that its code cannot hang or end the command.
"""

from __future__ import annotations

import io
import multiprocessing
import time
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass, field, replace
from functools import partial
from math import inf
from typing import TYPE_CHECKING, Any, NoReturn

from barc_sim.control.pid import KD, KI, KP
from barc_sim.errors import UserError
from barc_sim.lab.check.code import LocalCode
from barc_sim.lab.check.controller import judge_controller
from barc_sim.lab.check.findings import CRITERIA, EQUATIONS, LOOP, MODEL, PID, RELAY, Finding
from barc_sim.lab.check.loop import Conditions, Thresholds, judge_lab_road, judge_random_roads
from barc_sim.lab.check.model import (
    judge_equations,
    judge_general,
    judge_reverse,
    judge_trajectory,
)
from barc_sim.lab.check.relay import judge_relay
from barc_sim.lab.user_code.call import without_addresses
from barc_sim.lab.user_code.gains import ChosenGains
from barc_sim.lab.user_code.loading import FILES, UserCode, find_file, load_folder

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterator, Mapping
    from multiprocessing.connection import Connection
    from pathlib import Path

    from barc_sim.lab.check.code import JudgedCode

_DEFAULT = ChosenGains(KP, KI, KD, "barc_sim's own, because controller.py chooses none")
#: [s] Limit for one call of user code; a call in Python is ended then, with a message.
CALL_BUDGET = 0.5
#: [s] Limit for the process, which ends a sleep or a loop in C.
DEADLINE = 45.0
_CHARACTERS = 400  #: kept of the printed text


@dataclass(frozen=True)
class Settings:
    """How user code is judged."""

    seed: int = 0  #: of the states, the sequences of speeds and the random roads
    kp: float | None = None  #: on the roads; None: the file's own
    ki: float | None = None
    kd: float | None = None
    acceleration_limit: float = inf  #: [m/s²] on the roads; the lab's car has none
    thresholds: Thresholds = field(default_factory=Thresholds)
    criteria: Collection[str] = CRITERIA


def judge(code: JudgedCode, settings: Settings | None = None) -> list[Finding]:
    """Return a finding for each criterion of `settings`, in the order of `findings.CRITERIA`.

    Errors of the code become findings.
    """
    return [*_findings(code, settings or Settings())]


def _findings(code: JudgedCode, settings: Settings) -> Iterator[Finding]:
    """Yield the findings of `judge`, each as soon as it is known."""
    wanted = frozenset(settings.criteria)
    for part, criteria, judge_part in (
        ('model', MODEL, _judge_model),
        ('controller', (*PID, *LOOP), _judge_controller),
        ('relay', RELAY, lambda code, _: judge_relay(code)),
    ):
        found: Iterator[Finding] = iter(())
        if not code.has(part):
            message = f'there is no {FILES[part]}'
            found = (Finding(name, 0.0, message, skipped=True) for name in criteria)
        elif not wanted.isdisjoint(criteria):
            found = iter(judge_part(code, settings))
        yield from (finding for finding in found if finding.criterion in wanted)


def _judge_model(code: JudgedCode, settings: Settings) -> Iterator[Finding]:
    if not set(EQUATIONS).isdisjoint(settings.criteria):
        yield from judge_equations(code, settings.seed)
    judges: Mapping[str, Callable[[], Finding]] = {
        'model.trajectory': partial(judge_trajectory, code),
        'model.reverse': partial(judge_reverse, code, settings.seed),
        'model.general': partial(judge_general, code, settings.seed),
    }
    yield from (judge() for name, judge in judges.items() if name in settings.criteria)


def _judge_controller(code: JudgedCode, settings: Settings) -> Iterator[Finding]:
    yield from judge_controller(code, settings.seed, settings.criteria)
    gains = gains_used(code, settings)
    conditions = Conditions(gains, settings.acceleration_limit, settings.thresholds)
    if 'loop.lab_road' in settings.criteria:
        yield judge_lab_road(code, conditions)
    if 'loop.random_roads' in settings.criteria:
        yield judge_random_roads(code, conditions, settings.seed)


def gains_used(code: JudgedCode, settings: Settings) -> ChosenGains:
    """Return the gains with which the code drives: the command line's, the file's or barc_sim's."""
    chosen = code.chosen_gains() or _DEFAULT
    options = (settings.kp, settings.ki, settings.kd)
    if options == (None, None, None):
        return chosen
    kp, ki, kd = (c if g is None else g for g, c in zip(options, chosen[:3], strict=True))
    rest = '' if None not in options else f', the others from {chosen.origin}'
    return ChosenGains(kp, ki, kd, f'the command line{rest}')


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
    folder: Path, settings: Settings, *, budget: float = CALL_BUDGET, deadline: float = DEADLINE
) -> Report:
    """Return the findings on the files in `folder`, after `deadline` [s] at the latest.

    A call of its code may take `budget` [s]. There may be no files.
    """
    # A new interpreter, without the imports and patches of this process.
    context = multiprocessing.get_context('spawn')
    ours, theirs = context.Pipe(duplex=False)
    process = context.Process(target=_work, args=(theirs, folder, settings, budget), daemon=True)
    process.start()
    theirs.close()
    end = time.monotonic() + deadline
    found: dict[str, Finding] = {}
    wanted = [name for name in CRITERIA if name in settings.criteria]
    report = Report([], Printed())
    lost = f'no result within {deadline:g} s: is there an endless loop, or a sleep?'
    try:
        while len(found) < len(wanted) and ours.poll(max(end - time.monotonic(), 0.0)):
            report = ours.recv()
            found |= {finding.criterion: finding for finding in report.findings}
    except EOFError:
        process.join()
        lost = f'the code ended the whole process, with exit code {process.exitcode}'
    finally:
        process.kill()
        process.join()
        ours.close()
    findings = [found.get(name) or Finding(name, 0.0, lost) for name in wanted]
    return replace(report, findings=findings)


def _work(connection: Connection, folder: Path, settings: Settings, budget: float) -> None:
    printer = _Printer()
    with redirect_stdout(printer), redirect_stderr(printer):
        user_code = load_parts(folder, budget)
        code = LocalCode(user_code)
        gains = gains_used(code, settings) if code.has('controller') else None
        for finding in _findings(code, settings):
            connection.send(Report([finding], printer.printed(), gains, user_code.tolerated))


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
