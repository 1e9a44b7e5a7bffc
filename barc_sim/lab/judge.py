"""How user code is judged: by a lab's laws, and by the drives with it.

This uses no ROS, no clock and only seeded random numbers: a score is the same on every machine.
Tolerances are far above the differences between maths libraries, and far below any mistake.
"""

from __future__ import annotations

from collections import Counter
from contextlib import suppress
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from barc_sim.errors import UserError
from barc_sim.lab.confined.process import JudgedCode, Limits
from barc_sim.lab.law import Mistake
from barc_sim.lab.user_code.code import CALLED
from barc_sim.lab.user_code.folder import BY_EYE

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
    from pathlib import Path

    from matplotlib.figure import Figure

    from barc_sim.lab.files import ChosenGains, Handout
    from barc_sim.lab.law import Agree, Case, Floats, Inputs, Law

    Index = tuple[int, ...]

_SAMPLE = 100  #: inputs with which mistakes are tried
#: Relative to max(|expected|, 1): far above rounding errors, far below any mistake.
_TOLERANCE = 1e-9


class Trial(NamedTuple):
    """What user code returned for the inputs of a law."""

    function: str  #: what was called
    name: str  #: of the situation
    tests: Collection[str]  #: the results that it tests
    inputs: Inputs
    right: Mapping[str, Floats]  #: the law's quantities
    got: Mapping[str, Floats]  #: by result; NaN where the code failed
    failure: str = ''

    def largest_error(self, name: str) -> tuple[Index, float]:
        """Return the index of the largest error of a result, and its size."""
        errors = np.abs(self.got[name] - self.right[name])
        index = np.unravel_index(errors.argmax(), errors.shape)
        return tuple(map(int, index)), float(errors[index])


def close(got: Floats, expected: Floats) -> bool:
    """Return whether `got` is finite, and equals `expected` to rounding."""
    with np.errstate(invalid='ignore', over='ignore'):
        near = np.abs(got - expected) <= _TOLERANCE * np.maximum(1.0, np.abs(expected))
    return bool(np.all(near & np.isfinite(got)))


_ROUNDING = 1e-6  #: relative error that single precision makes, and more
_FACTOR, _SIGN = 0.4, 0.6  #: of a result's points; see `Functions.loss`
_ABSENT = 'Absent'  #: A topic that begins so is of results that are not there: each costs all.


def _loss(got: Floats, right: Floats, scale: float) -> float:
    """Return how wrong numbers of this scale are, from 0 to 1."""
    size = max(float(np.vdot(right, right)), right.size * (_ROUNDING * scale) ** 2)
    factor = float(np.vdot(got, right)) / size
    if factor and np.abs(got - factor * right).max() <= _ROUNDING * np.abs(got).max():
        return min(abs(factor - 1.0), _FACTOR) if factor > 0.0 else _SIGN
    error = float(np.sqrt(np.vdot(got - right, got - right) / size))
    return min(error, 1.0) if error >= 0.0 else 1.0


def _joined(trials: Sequence[Trial], name: str) -> Case:
    """Return what the code got and returned in several trials, of many calls some."""
    step = max(sum(len(trial.got[name]) for trial in trials) // _SAMPLE, 1)
    inputs = {
        key: np.concatenate([trial.inputs[key] for trial in trials])[::step]
        for key in trials[0].inputs
    }
    return inputs, np.concatenate([trial.got[name] for trial in trials])[::step]


def share(value: float, full: float, zero: float) -> float:
    """Return the share of the points: 1 up to `full`, 0 from `zero` on, linear in between."""
    return min(max(0.0, (zero - value) / (zero - full)), 1.0)  # of NaN 0


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


#: For `check`: its user waits, and has written the code: it is not confined.
_CHECKED = Limits(call=2.0, wait=10.0, total=45.0, confined=False)


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


class Evidence(NamedTuple):
    """A judged drive: a table that `check` prints, and the figure of `check` and `grade`."""

    title: str  #: of the table
    header: Sequence[str]
    rows: Sequence[Sequence[str]]  #: the drive, part by part
    figure: Callable[[str], Figure]  #: draws it with a title


class Part(NamedTuple):
    """How a lab judges one part of user code."""

    labels: Mapping[str, str]  #: its criteria, with their names for readers
    #: Yields a finding for each of them, until all that are asked for are found.
    judge: Callable[[JudgedCode, Settings], Iterable[Finding]]


@dataclass(frozen=True)
class Report:
    """The findings on a folder, and the text that its code printed."""

    findings: list[Finding]  #: of each criterion asked for
    printed: str  #: the first output of its code
    gains: ChosenGains | None  #: that drove the roads
    tolerated: tuple[str, ...]  #: a phrase each

    @property
    def drive(self) -> Evidence | None:
        """The drive that the findings show, if there is one."""
        return next((each.evidence for each in self.findings if each.evidence), None)


@dataclass(frozen=True)
class Lab:
    """A lab: what is handed out, and how what comes back is judged."""

    handout: Handout
    parts: Mapping[str, Part]
    #: What a person judges, with a sum of its own: by criterion, what to look at.
    by_eye: Mapping[str, str] = field(default_factory=dict)
    ready: Callable[[], object] = bool  #: a UserError, where what judges it is not installed

    @property
    def labels(self) -> dict[str, str]:
        """Every criterion, with its name for readers, in the order of a report."""
        return {name: label for part in self.parts.values() for name, label in part.labels.items()}

    def judge(self, code: JudgedCode, settings: Settings | None = None) -> list[Finding]:
        """Return a finding for each criterion of `settings`, in the order of the labels.

        An error of the code costs the criteria of its part that have no finding before it.
        """
        settings = settings or Settings()
        criteria = self.labels if settings.criteria is None else settings.criteria
        findings: list[Finding] = []
        for name, part in self.parts.items():
            asked, message = [each for each in part.labels if each in criteria], ''
            if not code.has(name):
                message = f'there is no {self.handout.files[name]}'
                findings += [Finding(each, 0.0, message, skipped=True) for each in asked]
                continue
            found = {
                each: Finding(each, 0.0, f'{what}: {BY_EYE}', open=True)
                for each, what in self.by_eye.items()
            }
            try:
                if {*asked} - found.keys():
                    for each in part.judge(code, settings):
                        found[each.criterion] = each
                        if found.keys() >= {*asked}:
                            break
            except UserError as error:
                message = str(error)
            findings += [found.get(each) or Finding(each, 0.0, message) for each in asked]
        return findings

    def judge_folder(self, folder: Path, settings: Settings, limits: Limits = _CHECKED) -> Report:
        """Return the findings on the files in `folder`; a process with limits calls their code.

        There may be no files.
        """
        with JudgedCode(folder, limits) as code:
            found = self.judge(code, settings)
            gains, tolerated = code.chosen_gains(), code.tolerated()
        return Report(found, code.printed, gains, tolerated)


@dataclass(frozen=True)
class Functions:
    """The functions of a file, with the law of their results; a situation has their names.

    What a function takes are quantities of the law.
    """

    law: Law
    #: By function: all numbers that it returns; one result alone is all of them, a row for a call.
    results: Mapping[str, tuple[str, ...]]
    criteria: Mapping[str, str]  #: by result that is judged, in the order of a report
    count: int = 100  #: calls in each situation
    agree: Agree = close
    min_loss: float = 0.1  #: of the points of a wrong result
    #: By function, one that it calls: what is wrong there is not taken off here.
    calls: Mapping[str, str] = field(default_factory=dict)

    @np.errstate(all='ignore')
    def judge(self, code: JudgedCode, seed: int | str) -> tuple[list[Finding], list[Trial]]:
        """Return a finding for each result that is judged, and all that was returned."""
        trials = [each for name in self.results for each in self._trials(code, name, seed)]
        judged = [
            each._replace(got={n: got for n, got in each.got.items() if n in self.criteria})
            for each in trials
        ]
        findings = []
        for name, (score, message) in self.verdicts(code, judged, self.criteria).items():
            cases = self.count * sum(name in trial.got for trial in trials)
            right = f'right in all {cases:,} cases'
            findings.append(Finding(self.criteria[name], score, message or right))
        return findings, trials

    def is_right(self, trial: Trial, name: str) -> bool:
        """Return whether a result is right."""
        return self.agree(trial.got[name], trial.right[name])

    def loss(self, trials: Sequence[Trial], name: str) -> float:
        """Return how wrong a result is, from 0 to 1.

        It is the mean of the trials that test it, and that of all others. A factor that is off by
        little costs little, another one more, a sign most; what is absent, or has nothing to do
        with the right result, costs all. A state is judged by its change.
        """
        tested, others = [0.0], [0.0]
        scale = max(float(np.abs(trial.right[name]).max()) for trial in trials)
        for trial in trials:
            old = trial.inputs.get(name.removesuffix('_next'), 0.0)
            got, right = trial.got[name] - old, trial.right[name] - old
            loss = 0.0 if self.is_right(trial, name) else _loss(got, right, scale)
            (tested if name in trial.tests else others).append(loss)
        shares = (sum(each) / max(len(each) - 1, 1) for each in (tested, others))
        loss = 1.0 - (1.0 - next(shares)) * (1.0 - next(shares))
        return float(max(loss, self.min_loss)) if loss else 0.0

    def verdicts(
        self, code: JudgedCode, trials: Sequence[Trial], names: Iterable[str]
    ) -> dict[str, tuple[float, str]]:
        """Return how right each result is, from 0 to 1, and the sentence on the mistake in it.

        It loses as much as it is wrong; for one known mistake no more than for a sign. A mistake in
        several results counts once: each of them loses its share.
        """
        own = {name: [trial for trial in trials if name in trial.got] for name in names}
        losses = {name: loss for name in own if (loss := self.loss(own[name], name))}
        causes = self._causes(trials, [*losses]) if losses else {}
        times = Counter(cause.kind for cause in causes.values())
        verdicts = dict.fromkeys(own, (1.0, ''))
        placed: dict[str, str] = {}  # one mistake has one line
        for name, cause in causes.items():
            share, most = losses[name] / times[cause.kind], _SIGN if cause.topic else 1.0
            lost = 1.0 if cause.topic.startswith(_ABSENT) else min(share, most)
            text = placed.setdefault(cause.sentence, self._placed(code, own[name], name, cause))
            verdicts[name] = 1.0 - lost, text
        return verdicts

    def _causes(self, trials: Sequence[Trial], wrong: Sequence[str]) -> dict[str, Mistake]:
        """Return for each wrong result the failure, the mistake, or its largest error."""
        causes: dict[str, Mistake] = {}
        cases: dict[str, Case] = {}
        for name in {name: 0 for trial in trials for name in trial.got}:
            own = [trial for trial in trials if name in trial.got]
            failed = [trial for trial in own if trial.failure]
            if len(failed) == len(own):
                causes[name] = Mistake(_ABSENT, failed[0].failure, {}, '')
            elif failed:
                text = f'{failed[0].failure} ({failed[0].name})'
                causes[name] = Mistake('', text, {}, text)
            else:
                cases[name] = _joined(own, name)
        named = self.law.explain(cases, [name for name in wrong if name in cases], self.agree)
        return {
            name: causes.get(name) or named.get(name) or self._unnamed(trials, name)
            for name in wrong
        }

    def _placed(self, code: JudgedCode, trials: Sequence[Trial], name: str, cause: Mistake) -> str:
        """Return the sentence of a mistake after the file and line of it, if these are known.

        It is the first line that gives a value of the wrong law to a name, and where there is none
        the one that returns.
        """
        # The last one is the most general. A failure names its line itself.
        trial = next((each for each in reversed(trials) if not self.is_right(each, name)), None)
        if trial is None or any(each.failure for each in trials):
            return cause.sentence
        index, _ = trial.largest_error(name)
        wrong = [*self.law.changed(trial.inputs, cause, index), float(trial.got[name][index])]
        line = self._line(code, trial, name, index, wrong)
        return f'{line}: {cause.sentence}' if line else cause.sentence

    def _unnamed(self, trials: Sequence[Trial], name: str) -> Mistake:
        """Return a mistake that no law has: a result that never changes, or its largest error."""
        own = [trial for trial in trials if name in trial.got]
        if not any(np.ptp(trial.got[name], axis=-1).any() for trial in own):
            values = {*np.concatenate([trial.got[name].ravel() for trial in own]).tolist()}
            always = f'{values.pop():.6g}' if len(values) == 1 else 'the same in a call'
            text = f'{name} is always {always}: is it computed, and returned?'
            return Mistake(_ABSENT, text, {}, text)
        bad = [trial for trial in own if not self.is_right(trial, name)]
        where = f' ({", ".join(trial.name for trial in bad)})' if len(bad) < len(own) else ''
        trial = max(bad, key=lambda each: each.largest_error(name)[1])
        index, _ = trial.largest_error(name)
        got, right = trial.got[name][index], trial.right[name][index]
        text = (
            f'{name} is wrong{where}. The largest error: {self._call(trial, index)} gave '
            f'{got:.9g}, expected {right:.9g}'
        )
        return Mistake('', text, {}, text)

    def _trials(self, code: JudgedCode, name: str, seed: int | str) -> Iterator[Trial]:
        """Call a function in each of its situations; yield what it returns."""
        results = self.results[name]
        for situation in self.law.situations[name]:
            inputs = situation.inputs(seed, self.count)
            found, failure = np.full((self.count, CALLED[name].numbers), np.nan), ''
            try:
                found = np.array(code.rows(name, self._rows(name, inputs)))
            except UserError as error:
                failure = str(error)
            got = dict(zip(results, [found] if len(results) == 1 else found.T, strict=True))
            given = self._given(code, name, inputs, found)
            about = name, situation.name, situation.tests
            yield Trial(*about, given, self.law.compute(given), got, failure)

    def _given(self, code: JudgedCode, name: str, inputs: Inputs, found: Floats) -> Inputs:
        """Return the inputs by which a function is judged.

        Where `found` is wrong, what the user's wrong function returns is one of them: what follows
        from that is right.
        """
        right = self.law.compute(inputs)
        if name in self.calls and not self.agree(found, right[name]):
            called = self.calls[name]
            with suppress(UserError):
                own = np.array(code.rows(called, self._rows(called, inputs)))
                follows = self.law.compute({**inputs, called: own})[name]
                if np.isfinite(follows).all() and not self.agree(own, right[called]):
                    return {**inputs, called: own}
        return inputs

    def _rows(self, name: str, inputs: Inputs) -> list[list[Any]]:
        values = self.law.compute(inputs)
        columns = [values[each].tolist() for each in _arguments(name)]
        return [[*row] for row in zip(*columns, strict=True)]

    def _line(
        self, code: JudgedCode, trial: Trial, name: str, index: Index, wrong: list[float]
    ) -> str:
        """Return the line in which a call gives one of these values to a name; empty: none does."""
        k = index[0]
        rows = self._rows(trial.function, {n: each[k : k + 1] for n, each in trial.inputs.items()})
        others = [float(trial.right[n][k]) for n in trial.got if n != name]
        request = trial.function, rows, True  # so that the constants of its file count, too
        return code.line_of('functions', request, wrong, others)

    def _call(self, trial: Trial, index: Index) -> str:
        """Return a call as text."""
        k, *number = index
        shown = (
            f'{name}={trial.inputs[name][k]:.6g}' if name in trial.inputs else name
            for name in _arguments(trial.function)
        )
        which = f', number {number[0] + 1},' if number else ''
        return f'{trial.function}({", ".join(shown)}){which}'


def _arguments(function: str) -> list[str]:
    return (CALLED[function].takes or '').split()
