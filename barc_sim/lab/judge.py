"""A lab as a value, and how its user code is judged: calls, functions, drives, and findings.

It uses no ROS, no clock and only seeded random numbers: a score is the same on every machine.
Tolerances are far above the differences between maths libraries, and far below any mistake.
"""

from __future__ import annotations

import time
from collections import Counter
from contextlib import suppress
from dataclasses import dataclass, field
from functools import partial
from math import isfinite
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from barc_sim.errors import UserError, one_line, without_addresses
from barc_sim.lab.confined.process import Ended, Failed, Limits, Process
from barc_sim.lab.files import ChosenGains, UserCodeError, files_in
from barc_sim.lab.laws import Judge, close, run

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
    from pathlib import Path

    from matplotlib.figure import Figure
    from typing_extensions import Self

    from barc_sim.lab.files import Handout
    from barc_sim.lab.laws import Agree, Index, Inputs, Law, Trial


_MAX_PHRASES = 20
_MAX_ENDS = 3  # a function that has ended its process, or looped, so often is not called again
#: The user's name for what a request calls.
_CALLED = {'make_lane': 'Lane', 'steer': 'Lane', 'relay_commands': 'relay'} | dict.fromkeys(
    ('make_pid', 'steps'), 'PID'
)


class JudgedCode:
    """A user's files in `folder`, called in a process confined to it; a lab adds what it calls.

    Each failure is a UserCodeError. If a call ends the process, the next one uses a new process.
    All calls together have `Limits.total` seconds; after that each one fails.
    """

    def __init__(self, folder: Path, limits: Limits | None = None, *, sandbox: bool = True) -> None:
        """Use the files in `folder`; the process starts at the first call."""
        self._folder = folder
        self._limits = limits or Limits()
        self._sandbox = sandbox
        self._process: Process | None = None
        self._left = self._limits.total
        self._ends: Counter[str] = Counter()
        self._reasons: dict[str, str] = {}
        self._printed = b''
        self._gains: ChosenGains | None = None

    def __enter__(self) -> Self:
        """Return the code; its process ends with the block."""
        return self

    def __exit__(self, *_: object) -> None:
        """End the process."""
        self.close()

    def has(self, part: str) -> bool:
        """Return whether there is the file of this part."""
        return part in files_in(self._folder)

    def rows(self, name: str, rows: Sequence[Sequence[Any]], size: int) -> list[Any]:
        """Return what a user's function returns for each row of arguments: `size` numbers."""
        found = self.call('functions', name, rows)
        return rows_of(name, found, len(rows), size)

    def chosen_gains(self) -> ChosenGains | None:
        """Return the gains that `controller.py`, once loaded, chooses; None if it has none."""
        with suppress(KeyError, TypeError, ValueError, OverflowError):
            kp, ki, kd, origin = self._notes()['gains']
            gains = ChosenGains(float(kp), float(ki), float(kd), one_line(str(origin), 100))
            if all(map(isfinite, gains[:3])):
                self._gains = gains  # they stay known when the process has ended
        return self._gains

    def tolerated(self) -> tuple[str, ...]:
        """Return what was tolerated in the files that are loaded, a phrase each."""
        phrases = self._notes().get('tolerated')
        known = phrases[:_MAX_PHRASES] if isinstance(phrases, (list, tuple)) else ()
        return tuple(one_line(str(phrase)) for phrase in known)

    def line_of(
        self, do: str, arguments: Sequence[Any], values: Iterable[float], others: Iterable[float]
    ) -> str:
        """Return the file and line that first gives one of the `values` to a name in a request.

        Values that are among the `others` do not count. Where no line does, it is the one that
        returns; empty if that is not known.
        """
        try:
            lines = [(str(at), float(value)) for at, value in self.call('lines', do, *arguments)]
        except (UserCodeError, TypeError, ValueError):
            return ''
        usual = np.array([0.0, 1.0, *others])
        wrong = np.array([v for v in values if not np.isclose(v, usual, 1e-12, 0.0).any()])
        near = (at for at, value in lines if np.isclose(value, wrong, 1e-9, 0.0).any())
        return one_line(next(near, lines[-1][0] if lines else ''), 100)

    def _notes(self) -> dict[str, Any]:
        try:
            notes = self.call('notes')
        except UserCodeError:
            return {}
        return notes if isinstance(notes, dict) else {}

    @property
    def printed(self) -> str:
        """The first output of the processes that have ended."""
        text = without_addresses(self._printed[: self._limits.output].decode(errors='replace'))
        return f'{text}\n[and more]' if len(self._printed) > self._limits.output else text

    def call(self, do: str, *arguments: Any) -> Any:  # noqa: ANN401 (JSON)
        """Return the result of a request.

        Raises
        ------
        UserCodeError
            if the function fails or ends its process.
        """
        function = self._called(do, *arguments)
        if self._ends[function] >= _MAX_ENDS:
            raise UserCodeError(self._reasons[function])
        if self._left <= 0.0:
            raise UserCodeError(self._out_of_time())
        if do == 'notes' and self._process is None:
            return {}
        if self._process is None:
            self._process = Process(self._folder, self._limits, sandbox=self._sandbox)
        began = time.monotonic()
        try:
            return self._process.request(do, *arguments, wait=min(self._limits.wait, self._left))
        except Failed as error:
            if 'is there an endless loop' in str(error):  # each such call takes all of its time
                self._ends[function] += 1
                self._reasons[function] = str(error)
            raise UserCodeError(str(error)) from None
        except Ended as error:
            self.close()
            if time.monotonic() - began >= self._left:
                raise UserCodeError(self._out_of_time()) from None
            self._ends[function] += 1
            self._reasons[function] = f'{function}: the process that called it {error}'
            raise UserCodeError(self._reasons[function]) from None
        finally:
            self._left -= time.monotonic() - began

    def _called(self, do: str, *arguments: Any) -> str:  # noqa: ANN401 (JSON)
        if do == 'lines':
            return self._called(*arguments)
        return str(arguments[0]) if do == 'functions' else _CALLED.get(do, do)

    def _out_of_time(self) -> str:
        return (
            f'the code has used up the {self._limits.total:g} s that it has in all; does it '
            'sleep, or wait for something?'
        )

    def close(self) -> None:
        """End the process, if there is one."""
        if self._process is not None:
            self._process.close()
            self._printed += self._process.printed
            self._process = None


def share(value: float, full: float, zero: float) -> float:
    """Return the share of the points: 1 up to `full`, 0 from `zero` on, linear in between."""
    return min(max(0.0, (zero - value) / (zero - full)), 1.0)  # of NaN 0


def rows_of(function: str, found: Any, rows: int, columns: int) -> list[Any]:  # noqa: ANN401
    """Return rows of numbers: the process can send anything."""
    if not isinstance(found, list) or len(found) != rows:
        raise UserCodeError(f'{function} returned something else than {rows} rows of numbers')
    return [tuple(numbers_of(function, row, columns)) for row in found]


def numbers_of(function: str, found: Any, size: int) -> list[float]:  # noqa: ANN401
    """Return `size` finite numbers that a function returned."""
    if not isinstance(found, (list, tuple)) or len(found) != size:
        raise UserCodeError(f'{function} returned something else than {size} numbers')
    if not all(type(value) is float and isfinite(value) for value in found):
        raise UserCodeError(f'{function} returned numbers that are not finite')
    return [*found]


@dataclass(frozen=True)
class Finding:
    """How far a criterion is met, and what to check if it is not."""

    criterion: str  #: a part and a name, as in `model.x`
    score: float  #: from 0 to 1; 1 is full marks
    message: str  #: one or two sentences, in the terms of the lab
    evidence: Any = field(default=None, compare=False, repr=False)  #: what a figure shows
    skipped: bool = False  #: there is no such file: the score is 0
    open: bool = False  #: it cannot be judged here: the points are open

    @property
    def passed(self) -> bool:
        """Whether the criterion has full marks."""
        return self.score >= 1.0


#: Score, message and evidence of a finding.
Judged = tuple[float, str] | tuple[float, str, Any]


@np.errstate(all='ignore')
def judged(criterion: str, judge: Callable[..., Judged], *args: Any) -> Finding:  # noqa: ANN401
    """Return the finding on a criterion: what `judge` returns, or nothing for an error of the code.

    NumPy warns of no number: user code can return those of any size.
    """
    try:
        return Finding(criterion, *judge(*args))
    except UserError as error:
        return Finding(criterion, 0.0, str(error))


#: For `check`: its user waits, and has written the code.
_CHECKED = Limits(call=2.0, wait=10.0, total=45.0)


@dataclass(frozen=True)
class Thresholds:
    """Errors of a drive, RMS and maximum, for half of the marks each.

    Full marks up to `full_…`, none from `zero_…` on, linear in between. The defaults are those of
    the hills: speed errors [m/s] after the run-up.
    """

    full_rms: float = 0.15
    zero_rms: float = 1.5
    full_max: float = 0.5
    zero_max: float = 3.0

    def score(self, rms: float, maximum: float) -> float:
        """Return the score for the errors of a drive, from 0 to 1."""
        of_rms = share(rms, self.full_rms, self.zero_rms)
        return 0.5 * (of_rms + share(maximum, self.full_max, self.zero_max))


@dataclass(frozen=True)
class Settings:
    """How user code is judged."""

    seed: int = 0  #: of the states, the sequences and the hidden track
    thresholds: Thresholds = field(default_factory=Thresholds)
    criteria: Collection[str] | None = None  #: None: all


class Table(NamedTuple):
    """What a drive was like, part by part, as text."""

    title: str
    header: Sequence[str]
    rows: Sequence[Sequence[str]]


class Evidence(NamedTuple):
    """A judged drive, as `check` prints it, and as the figures of `check` and `grade` show it."""

    table: Table  #: the drive, part by part
    figure: Callable[[str], Figure]  #: draws it with a title


class Part(NamedTuple):
    """How a lab judges one part of user code."""

    labels: Mapping[str, str]  #: its criteria, with their names for readers
    judge: Callable[..., Iterable[Finding]]  #: gets the code, the settings and the criteria


@dataclass(frozen=True)
class Report:
    """The findings on a folder, and the text that its code printed."""

    findings: list[Finding]  #: of each criterion asked for
    printed: str  #: the first output of its code
    gains: ChosenGains | None  #: that drove the roads
    tolerated: tuple[str, ...]  #: a phrase each

    @property
    def judged(self) -> list[Finding]:
        """The findings on what is there, and can be judged."""
        return [each for each in self.findings if not (each.skipped or each.open)]

    @property
    def drive(self) -> Evidence | None:
        """The drive that the findings show, if there is one."""
        return next((each.evidence for each in self.findings if each.evidence), None)


@dataclass(frozen=True)
class Lab:
    """A lab: what is handed out, and how what comes back is judged."""

    handout: Handout
    code: type[JudgedCode]  #: its requests
    parts: Mapping[str, Part]
    by_eye: frozenset[str] = frozenset()  #: criteria that a person judges, with a sum of their own

    @property
    def labels(self) -> dict[str, str]:
        """Every criterion, with its name for readers, in the order of a report."""
        return {name: label for part in self.parts.values() for name, label in part.labels.items()}

    def judge(self, code: JudgedCode, settings: Settings | None = None) -> list[Finding]:
        """Return a finding for each criterion of `settings`, in the order of the labels.

        Errors of the code become findings.
        """
        settings = settings or Settings()
        criteria = self.labels if settings.criteria is None else settings.criteria
        findings: list[Finding] = []
        for name, part in self.parts.items():
            found: Iterable[Finding] = ()
            if not code.has(name):
                message = f'there is no {self.handout.files[name]}'
                found = [Finding(each, 0.0, message, skipped=True) for each in part.labels]
            elif not part.labels.keys().isdisjoint(criteria):
                found = part.judge(code, settings, criteria)
            findings += [finding for finding in found if finding.criterion in criteria]
        return findings

    def judge_folder(
        self, folder: Path, settings: Settings, limits: Limits = _CHECKED, *, sandbox: bool = False
    ) -> Report:
        """Return the findings on the files in `folder`; a process with limits calls their code.

        There may be no files. Without `sandbox` their code is not confined: it is the user's own.
        """
        with self.code(folder, limits, sandbox=sandbox) as code:
            found = self.judge(code, settings)
            gains, tolerated = code.chosen_gains(), code.tolerated()
        return Report(found, code.printed, gains, tolerated)


_MIN_LOSS = 0.1  #: of a result's points


@dataclass(frozen=True)
class Functions:
    """The functions of a file, with the law of their results; a situation has their names."""

    law: Law
    inputs: Mapping[str, str]  #: that a sentence shows, by function
    results: Mapping[str, tuple[str, ...]]  #: all numbers that it returns, by function
    criteria: Mapping[str, str]  #: by result that is judged, in the order of a report
    count: int = 100  #: calls in each situation
    agree: Agree = close
    #: Makes the arguments of each call of the inputs; without it, they are those.
    arguments: Callable[[Inputs], list[list[Any]]] | None = None

    @np.errstate(all='ignore')
    def judge(self, code: JudgedCode, seed: int | str) -> tuple[list[Finding], list[Trial]]:
        """Return a finding for each result that is judged, and all that was returned."""
        trials = [each for name in self.results for each in self._trials(code, name, seed)]
        judge = Judge(self.law, self.agree, self._shown, partial(self._line, code), _MIN_LOSS)
        judged = [
            each._replace(got={n: got for n, got in each.got.items() if n in self.criteria})
            for each in trials
        ]
        findings = []
        for name, verdict in judge.judge(judged, self.criteria).items():
            cases = self.count * sum(name in trial.got for trial in trials)
            message = verdict.message or f'right in all {cases:,} cases'
            findings.append(Finding(self.criteria[name], verdict.score, message))
        return findings, trials

    def _trials(self, code: JudgedCode, name: str, seed: int | str) -> list[Trial]:
        """Return what a function returns in its situations."""

        def call(inputs: Inputs) -> list[Any]:
            return code.rows(name, self._rows(name, inputs), len(self.results[name]))

        return run(call, self.results[name], self.law.situations[name], seed, self.count)

    def _rows(self, name: str, inputs: Inputs) -> list[list[Any]]:
        if self.arguments:
            return self.arguments(inputs)
        rows: list[list[Any]] = np.array([inputs[n] for n in self.inputs[name].split()]).T.tolist()
        return rows

    def _function(self, trial: Trial) -> str:
        names = (name for name, results in self.results.items() if {*results} >= {*trial.got})
        return next(names)

    def _line(
        self, code: JudgedCode, trial: Trial, name: str, index: Index, wrong: list[float]
    ) -> str:
        function, (k,) = self._function(trial), index
        rows = self._rows(function, {n: each[k : k + 1] for n, each in trial.inputs.items()})
        others = [float(self.law.compute(trial.inputs)[n][k]) for n in trial.got if n != name]
        request = function, rows, True  # so that the constants of its file count, too
        return code.line_of('functions', request, wrong, others)

    def _shown(self, trial: Trial, index: Index) -> str:
        function = self._function(trial)
        names = self.inputs[function].split()
        values = (f'{name}={trial.inputs[name][index]:.6g}' for name in names)
        return f'{function}({", ".join(values)})'
