"""Judges user code by a lab's laws, and by test drives.

A score is the same on every machine with the same versions of Python and NumPy: no ROS, no clock,
and only seeded random numbers. Tolerances are far above the differences between maths libraries,
and far below the effect of any mistake.

Points never rise by a further mistake, and a mistake costs points once. Three rules see to it:

1. Where a mistake would cost points a second time, user code is called, or drives, with this
   mistake alone undone. All else stays the user's, with its other mistakes. For example, `Lane`
   steers to the wrong side for e_y: the criterion of the signs loses points; then `Lane` drives,
   and gets -e_y.
2. Code of barc_sim's takes the place only of what is already known to be wrong, where it cannot be
   undone. For example, an integral term that does not add up: its own criterion loses points; then
   the user's PID drives with ki = 0, and the integral of barc_sim is added within the limits of the
   user's output, which may be wrong, too.
3. The first answers of a function are those that are judged. No later answer excuses another
   function: code that answers differently the second time gains nothing. For example, `program`
   calls `predict`, which is judged, too: while `program` is judged, `predict` returns the right
   results (see `Functions.calls`), not its own.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from barc_sim.errors import UserError
from barc_sim.lab.confined.process import JudgedCode, ProcessLimits
from barc_sim.lab.files import CALLED, UserCodeError, missing
from barc_sim.lab.law import Mistake
from barc_sim.lab.user_code.folder import BY_EYE

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
    from pathlib import Path

    from matplotlib.figure import Figure

    from barc_sim.lab.files import ChosenGains, Handout
    from barc_sim.lab.law import Agree, Case, Floats, Inputs, Law

    Index = tuple[int, ...]
    #: A user's function, arguments, and its right results for them.
    RightResults = tuple[str, list[list[Any]], list[list[float]]]

#: Relative to max(|expected|, 1): far above rounding errors, far below any mistake.
_TOLERANCE = 1e-9


class Trial(NamedTuple):
    """The results of user code in one situation of a law, beside the right ones."""

    function: str  #: the user's function
    name: str  #: of the situation
    tests: Collection[str]  #: the results that it tests
    inputs: Inputs
    right: Mapping[str, Floats]  #: the law's quantities
    got: Mapping[str, Floats]  #: what the function returned, by result; NaN where it failed
    failure: str = ''  #: the function's error

    def largest_error(self, name: str) -> tuple[Index, float]:
        """Return the index of the largest error of a result, and its size."""
        errors = np.abs(self.got[name] - self.right[name])
        index = np.unravel_index(errors.argmax(), errors.shape)
        return tuple(map(int, index)), float(errors[index])


def close(got: Floats, expected: Floats) -> bool:
    """Return whether `got` is finite, and equals `expected` up to rounding."""
    with np.errstate(invalid='ignore', over='ignore'):
        near = np.abs(got - expected) <= _TOLERANCE * np.maximum(1.0, np.abs(expected))
    return bool(np.all(near & np.isfinite(got)))


_ROUNDING = 1e-6  #: relative error, larger than in single precision
FACTOR_LOSS = 0.4  #: loss for a wrong factor; see `TrialJudge.loss`
SIGN_LOSS = 0.6  #: loss for a wrong sign
UNRELATED = 0.95  #: relative error from which on a result has nothing of the right one
_ABSENT = 'Absent'  #: The topic of a missing result begins so: each costs all its points.


def _is_absent(cause: Mistake) -> bool:
    return cause.topic.startswith(_ABSENT)


def _loss(got: Floats, right: Floats, scale: float) -> float:
    """Return the lost share of the points, from 0 to 1, for numbers of this scale."""
    size = max(float(np.vdot(right, right)), right.size * (_ROUNDING * scale) ** 2)

    # Is it the right result times a factor?
    factor = float(np.vdot(got, right)) / size
    if factor and np.abs(got - factor * right).max() <= _ROUNDING * np.abs(got).max():
        return min(abs(factor - 1.0), FACTOR_LOSS) if factor > 0.0 else SIGN_LOSS

    error = float(np.sqrt(np.vdot(got - right, got - right) / size))
    return error if error < UNRELATED else 1.0  # 1 for NaN


def _joined(trials: Sequence[Trial], name: str) -> Case:
    """Return inputs and results of several trials in one array."""
    got = np.concatenate([trial.got[name] for trial in trials])
    inputs = {
        key: np.concatenate([trial.inputs[key] for trial in trials]) for key in trials[0].inputs
    }
    return inputs, got


def _mean(losses: Sequence[float]) -> float:
    """Return the mean; 0 without any."""
    return sum(losses) / max(len(losses), 1)


def share(value: float, full: float, zero: float) -> float:
    """Return the share of the points: 1 up to `full`, 0 from `zero` on, linear in between."""
    return min(max(0.0, (zero - value) / (zero - full)), 1.0)  # 0 for NaN


@dataclass(frozen=True)
class Finding:
    """The score for a criterion, and a message on what to check."""

    #: A heading and a name, as in `model.x`. The heading is not always the part: `loop.lab_road` is
    #: of the part `controller`, too.
    criterion: str
    score: float  #: from 0 to 1; 1 is full marks
    message: str  #: one or two sentences, in the terms of the lab
    #: The judged drive, where there is one.
    evidence: Evidence | None = field(default=None, compare=False, repr=False)
    skipped: bool = False  #: there is nothing to judge: the score is 0
    open: bool = False  #: a person judges it: the points are open

    @property
    def passed(self) -> bool:
        """Whether the criterion has full marks."""
        return self.score >= 1.0


def needs_person(error: UserError) -> bool:
    """Return whether an error shows that a person must judge the code of its part."""
    return isinstance(error, UserCodeError) and error.kind.needs_person


#: For `check`: short, because its user waits; not confined, because its user wrote the code.
_CHECKED = ProcessLimits(call=2.0, wait=10.0, total=45.0, confined=False)


@dataclass(frozen=True)
class Thresholds:
    """The RMS and the maximum error of a drive that give full marks, and none.

    Each of the two errors counts for half of the score. Full marks up to `full_…`, none from
    `zero_…` on, linear in between. The defaults are for the hills: speed errors [m/s] after the
    run-up.
    """

    full_rms: float = 0.15
    zero_rms: float = 1.5
    full_max: float = 0.5
    zero_max: float = 3.0

    def score(self, rms: float, maximum: float) -> float:
        """Return the score for the errors of a drive, from 0 to 1."""
        rms_share = share(rms, self.full_rms, self.zero_rms)
        return 0.5 * (rms_share + share(maximum, self.full_max, self.zero_max))


@dataclass(frozen=True)
class Settings:
    """The seed, the thresholds and the criteria by which user code is judged.

    `criteria` and `points` are apart, because a caller can judge criteria without points, as tests
    do. From a `Rubric`, `criteria` are the keys of `points`. Judging gives scores from 0 to 1; it
    uses points only to divide what one mistake costs among several results. The rubric itself
    computes a grade's points.
    """

    seed: int = 0  #: of the test states, the test sequences and the hidden track
    thresholds: Thresholds = field(default_factory=Thresholds)
    criteria: Collection[str] | None = None  #: those to judge; None: all
    #: Points by criterion; one that is not in it counts like one with 1 point.
    points: Mapping[str, float] = field(default_factory=dict, hash=False)


class Evidence(NamedTuple):
    """A judged drive: the table that `check` prints, and the figure of `check` and `grade`."""

    title: str  #: of the table
    header: Sequence[str]
    rows: Sequence[Sequence[str]]  #: the drive, part by part
    figure: Callable[[str], Figure]  #: draws it with a title


class JudgedPart(NamedTuple):
    """How a lab judges one part of user code."""

    labels: Mapping[str, str]  #: its criteria, with their names for readers
    #: Yields a finding for each criterion. `Lab.judge` takes no more once it has all requested
    #: ones.
    judge: Callable[[JudgedCode, Settings], Iterable[Finding]]


@dataclass(frozen=True)
class JudgedFolder:
    """The findings on a folder, and the text that its code printed."""

    findings: list[Finding]  #: one for each requested criterion
    printed: str  #: the first output of its code
    gains: ChosenGains | None  #: of the drives
    tolerated: tuple[str, ...]  #: faults of its files that cost nothing, a phrase each

    @property
    def drive(self) -> Evidence | None:
        """The first judged drive, if there is one."""
        return next((each.evidence for each in self.findings if each.evidence), None)


def _needs_no_package() -> None:
    """Do nothing: most labs need only the packages of barc_sim itself."""


@dataclass(frozen=True)
class Lab:
    """A lab: the files that it hands out, and how submissions are judged."""

    handout: Handout
    parts: Mapping[str, JudgedPart]
    #: The criteria that a person judges, with what to look at. Their points have a separate sum.
    by_eye: Mapping[str, str] = field(default_factory=dict)
    #: Raises a UserError if a package that this lab alone needs is not installed.
    check_packages: Callable[[], object] = _needs_no_package

    @property
    def labels(self) -> dict[str, str]:
        """Every criterion, with its name for readers, in the order of a report."""
        return {name: label for part in self.parts.values() for name, label in part.labels.items()}

    @np.errstate(all='ignore')  # a stranger's numbers have any size
    def judge(self, code: JudgedCode, settings: Settings | None = None) -> list[Finding]:
        """Return a finding for each criterion of `settings`, in the order of the labels.

        An error of the code costs the criteria of its part that have no finding yet; if a person
        must judge the code, they are open.
        """
        settings = settings or Settings()
        criteria = self.labels if settings.criteria is None else settings.criteria

        findings: list[Finding] = []
        for name, part in self.parts.items():
            requested = [criterion for criterion in part.labels if criterion in criteria]
            if code.has(name):
                findings += self._judge_part(part, code, settings, requested)
            else:
                message = missing(self.handout, name, code.files())
                findings += [Finding(each, 0.0, message, skipped=True) for each in requested]
        return findings

    def _judge_part(
        self, part: JudgedPart, code: JudgedCode, settings: Settings, requested: Sequence[str]
    ) -> list[Finding]:
        """Return a finding for each requested criterion of a part."""
        findings = {
            criterion: Finding(criterion, 0.0, f'{what}: {BY_EYE}', open=True)
            for criterion, what in self.by_eye.items()
        }
        message = ''
        is_open = False
        try:
            if {*requested} - findings.keys():
                for finding in part.judge(code, settings):
                    findings[finding.criterion] = finding
                    if findings.keys() >= {*requested}:
                        break
        except UserError as error:
            message = str(error)
            is_open = needs_person(error)
        return [
            findings.get(criterion) or Finding(criterion, 0.0, message, open=is_open)
            for criterion in requested
        ]

    def judge_folder(
        self, folder: Path, settings: Settings, limits: ProcessLimits = _CHECKED
    ) -> JudgedFolder:
        """Return the findings on the files in `folder`; a process with limits calls their code.

        The folder may have none of the files.
        """
        with JudgedCode(folder, limits) as code:
            findings = self.judge(code, settings)
            gains = code.chosen_gains()
            tolerated = code.tolerated()
        return JudgedFolder(findings, code.printed, gains, tolerated)


class ScoredResult(NamedTuple):
    """The score of a result."""

    score: float  #: from 0 to 1
    cause: Mistake | None = None  #: of what it has lost


@dataclass(frozen=True)
class TrialJudge(ABC):
    """Judges trials by a law: the score of each result, and the message on the mistake in it.

    A class for each kind of trial says how to show a call, and how to find its line.
    """

    law: Law
    agree: Agree = close
    min_loss: float = 0.1  #: the minimum loss for a wrong result
    #: By result, its name for students, where it has another one in the law.
    shown_names: Mapping[str, str] = field(default_factory=dict)

    def is_right(self, trial: Trial, name: str) -> bool:
        """Return whether a result is right."""
        return self.agree(trial.got[name], trial.right[name])

    def loss(self, trials: Sequence[Trial], name: str) -> float:
        """Return the lost share of a result's points, from 0 to 1.

        The mean over the trials that test it and the mean over the others both count. A slightly
        wrong factor costs little, a very wrong one more, a wrong sign even more; a result that is
        missing, or unrelated to the right one, costs all. A state is judged by its change.
        """
        in_tests: list[float] = []
        in_others: list[float] = []
        scale = max(float(np.abs(trial.right[name]).max()) for trial in trials)
        for trial in trials:
            loss = 0.0
            if not self.is_right(trial, name):
                old = trial.inputs.get(name.removesuffix('_next'), 0.0)
                loss = _loss(trial.got[name] - old, trial.right[name] - old, scale)
            if name in trial.tests:
                in_tests.append(loss)
            else:
                in_others.append(loss)

        total = 1.0 - (1.0 - _mean(in_tests)) * (1.0 - _mean(in_others))
        return float(max(total, self.min_loss)) if total else 0.0

    def verdicts(
        self, code: JudgedCode, trials: Sequence[Trial], weights: Mapping[str, float]
    ) -> dict[str, tuple[float, str]]:
        """Return the score of each result, from 0 to 1, and the message on the mistake in it."""
        verdicts = {}
        messages: dict[str, str] = {}  # one mistake has one line
        for name, result in self.scores(trials, weights).items():
            text = ''
            if result.cause:
                message = self._message(code, _with_result(trials, name), name, result.cause)
                text = messages.setdefault(result.cause.sentence, message)
            verdicts[name] = result.score, text
        return verdicts

    def scores(
        self, trials: Sequence[Trial], weights: Mapping[str, float]
    ) -> dict[str, ScoredResult]:
        """Return the score of each result, from the trials alone.

        A mistake of the law costs at most `SIGN_LOSS`, what a wrong sign costs. Such a mistake has
        a name: it is one wrong idea, and the rest of the formula is right. Its size in numbers does
        not matter then, because it depends on the units and on the test cases: an angle in degrees
        is wrong by the factor 57, but is no worse a mistake than a sign. Only a result that is
        missing, or unrelated to the right one without a known reason, costs more.

        A mistake in several results counts once: together they lose what it costs in the result
        that loses most by it. `weights` are the points of each result.

        For example, a wrong beta costs 0.3 of the 9 points for x, and 0.6 of the 14 points for psi:
        2.7 and 8.4 points. Together they lose the larger one, 8.4 points. So each loses
        8.4 / (2.7 + 8.4) = 0.757 of its own: x loses 2.04 points, psi 6.36.
        """
        losses = {name: self.loss(_with_result(trials, name), name) for name in weights}
        wrong = [name for name, loss in losses.items() if loss]
        causes = self._causes(trials, wrong) if wrong else {}
        lost = {
            name: min(losses[name], SIGN_LOSS if cause.topic else 1.0)
            for name, cause in causes.items()
        }

        scores = dict.fromkeys(weights, ScoredResult(1.0))
        for name, cause in causes.items():
            if _is_absent(cause):
                scores[name] = ScoredResult(0.0, cause)
                continue
            same_mistake = [each for each, other in causes.items() if other.kind == cause.kind]
            lost_points = [weights[each] * lost[each] for each in same_mistake]
            charged_share = max(lost_points) / sum(lost_points) if any(lost_points) else 1.0
            scores[name] = ScoredResult(1.0 - lost[name] * charged_share, cause)
        return scores

    def _causes(self, trials: Sequence[Trial], wrong: Sequence[str]) -> dict[str, Mistake]:
        """Return the cause of each wrong result: a failure, a mistake of the law, or neither."""
        causes: dict[str, Mistake] = {}
        cases: dict[str, Case] = {}
        names = dict.fromkeys(name for trial in trials for name in trial.got)
        for name in names:
            trials_of_name = _with_result(trials, name)
            failed = [trial for trial in trials_of_name if trial.failure]
            if len(failed) == len(trials_of_name):
                causes[name] = Mistake(_ABSENT, failed[0].failure, {}, '')
            elif failed:
                text = f'{failed[0].failure} ({failed[0].name})'
                causes[name] = Mistake('', text, {}, text)
            else:
                cases[name] = _joined(trials_of_name, name)

        mistakes = self.law.explain(cases, [name for name in wrong if name in cases], self.agree)
        return {
            name: causes.get(name) or mistakes.get(name) or self._unnamed(trials, name)
            for name in wrong
        }

    def _message(self, code: JudgedCode, trials: Sequence[Trial], name: str, cause: Mistake) -> str:
        """Return the message on a mistake, with file and line before it if they are known.

        The line is the first one that assigns a value of the wrong law; else the return.
        """
        # The last wrong trial is the most general. A failure names its line itself.
        wrong_trials = [each for each in trials if not self.is_right(each, name)]
        if not wrong_trials or any(each.failure for each in trials):
            return cause.sentence
        trial = wrong_trials[-1]
        index, _ = trial.largest_error(name)
        wrong = [*self.law.changed(trial.inputs, cause, index), float(trial.got[name][index])]
        line = self._line(code, trial, name, index, wrong)
        return f'{line}: {cause.sentence}' if line else cause.sentence

    def _unnamed(self, trials: Sequence[Trial], name: str) -> Mistake:
        """Return the cause if no mistake of the law matches: a constant, or the largest error."""
        trials = _with_result(trials, name)
        shown_name = self.shown_names.get(name, name)
        if not any(np.ptp(trial.got[name], axis=-1).any() for trial in trials):
            values = {*np.concatenate([trial.got[name].ravel() for trial in trials]).tolist()}
            always = f'{values.pop():.6g}' if len(values) == 1 else 'the same in a call'
            text = f'{shown_name} is always {always}: is it computed, and returned?'
            return Mistake(_ABSENT, text, {}, text)

        wrong_trials = [trial for trial in trials if not self.is_right(trial, name)]
        where = ''
        if len(wrong_trials) < len(trials):
            where = f' ({", ".join(trial.name for trial in wrong_trials)})'
        worst = max(wrong_trials, key=lambda trial: trial.largest_error(name)[1])
        index, _ = worst.largest_error(name)
        text = (
            f'{shown_name} is wrong{where}. The largest error: {self._call(worst, index)} gave '
            f'{worst.got[name][index]:.9g}, expected {worst.right[name][index]:.9g}'
        )
        return Mistake('', text, {}, text)

    @abstractmethod
    def _call(self, trial: Trial, index: Index) -> str:
        """Return a call with its arguments as text."""

    @abstractmethod
    def _line(
        self, code: JudgedCode, trial: Trial, name: str, index: Index, wrong: list[float]
    ) -> str:
        """Return file and line where a call assigns one of these values; empty if nowhere."""


@dataclass(frozen=True, kw_only=True)
class Functions(TrialJudge):
    """Judges the functions of a user's file by a law, which has situations for each function.

    The arguments of a function are quantities of the law.
    """

    #: By function, the names of the numbers that it returns; a single name is for the whole list.
    results: Mapping[str, tuple[str, ...]]
    #: By judged result, in the order of a report.
    criteria: Mapping[str, str]
    count: int = 100  #: calls in each situation
    #: By function, another one that it calls: a mistake in that one costs points only there.
    calls: Mapping[str, str] = field(default_factory=dict)
    #: Results [rad] that are right with any number of full turns.
    angles: Collection[str] = ()

    @np.errstate(all='ignore')
    def judge(
        self, code: JudgedCode, seed: int | str, points: Mapping[str, float] | None = None
    ) -> tuple[list[Finding], list[Trial]]:
        """Return a finding for each judged result, and the trials of all results.

        `points` by criterion divide what a mistake in several results costs. A result without a
        criterion is tried, but not judged here: the lab itself judges it by its trial.
        """
        trials = [each for name in self.results for each in self._trials(code, name, seed)]
        judged = []
        for trial in trials:
            got = {name: values for name, values in trial.got.items() if name in self.criteria}
            judged.append(trial._replace(got=got))

        points = points or {}
        weights = {name: points.get(criterion, 1.0) for name, criterion in self.criteria.items()}
        findings = []
        for name, (score, message) in self.verdicts(code, judged, weights).items():
            cases = self.count * sum(name in trial.got for trial in trials)
            right = f'right in all {cases:,} cases'
            findings.append(Finding(self.criteria[name], score, message or right))
        return findings, trials

    def trials_with(self, mistake: Mistake, seed: int) -> list[Trial]:
        """Return the trials of code that is right but for a mistake of the law."""
        trials = []
        for function, results in self.results.items():
            for situation in self.law.situations[function]:
                inputs = situation.inputs(seed, self.count)
                right = self.law.compute(inputs)
                wrong = self.law.compute(inputs, mistake.formulas)
                got = {
                    name: np.broadcast_to(wrong[name], right[name].shape)
                    for name in results
                    if name in self.criteria
                }
                got = self._without_turns(got, right)
                trial = Trial(function, situation.name, situation.tests, inputs, right, got)
                trials.append(trial)
        return trials

    def _without_turns(
        self, got: Mapping[str, Floats], right: Mapping[str, Floats]
    ) -> dict[str, Floats]:
        """Return results without the full turns in those that are angles."""
        return {
            name: _unwound(values, right[name]) if name in self.angles else values
            for name, values in got.items()
        }

    def _trials(self, code: JudgedCode, name: str, seed: int | str) -> Iterator[Trial]:
        """Call a function in each of its situations; yield the trials."""
        results = self.results[name]
        for situation in self.law.situations[name]:
            inputs: Inputs = situation.inputs(seed, self.count)
            right = self.law.compute(inputs)

            numbers = np.full((self.count, CALLED[name].numbers), np.nan)
            failure = ''
            try:
                rows = code.rows(name, self._rows(name, inputs), self._right_results(name, inputs))
                numbers = np.array(rows)
            except UserError as error:
                if needs_person(error):
                    raise
                failure = str(error)

            if len(results) == CALLED[name].numbers:
                got = dict(zip(results, numbers.T, strict=True))
            else:
                got = {results[0]: numbers}
            got = self._without_turns(got, right)
            yield Trial(name, situation.name, situation.tests, inputs, right, got, failure)

    def _right_results(self, name: str, inputs: Inputs) -> RightResults | None:
        """Return the right answers of the user's function that this one calls; None without one.

        So its own mistakes alone count. No answer of the other function is used: it could differ
        from those that were judged.
        """
        if name not in self.calls:
            return None
        callee = self.calls[name]
        results = self.law.compute(inputs)[callee].tolist()
        return callee, self._rows(callee, inputs), results

    def _rows(self, name: str, inputs: Inputs) -> list[list[Any]]:
        values = self.law.compute(inputs)
        columns = [values[each].tolist() for each in _arguments(name)]
        return [[*row] for row in zip(*columns, strict=True)]

    def _line(
        self, code: JudgedCode, trial: Trial, name: str, index: Index, wrong: list[float]
    ) -> str:
        """Return file and line where a call assigns one of these values; empty if nowhere."""
        k = index[0]
        inputs = {n: values[k : k + 1] for n, values in trial.inputs.items()}
        rows = self._rows(trial.function, inputs)
        corrected = self._right_results(trial.function, inputs)
        others = [float(trial.right[n][k]) for n in trial.got if n != name]
        fresh = True  # The file is loaded again, so that lines with its constants are traced, too.
        request = trial.function, rows, fresh, corrected
        return code.line_of('functions', request, wrong, others)

    def _call(self, trial: Trial, index: Index) -> str:
        """Return a call with its arguments as text."""
        k = index[0]
        arguments = [
            f'{name}={trial.inputs[name][k]:.6g}' if name in trial.inputs else name
            for name in _arguments(trial.function)
        ]
        which = f', number {index[1] + 1},' if len(index) > 1 else ''
        return f'{trial.function}({", ".join(arguments)}){which}'


def _with_result(trials: Sequence[Trial], name: str) -> list[Trial]:
    """Return the trials that have a result of this name."""
    return [trial for trial in trials if name in trial.got]


def _unwound(got: Floats, right: Floats) -> Floats:
    """Return angles [rad] without the full turns by which some differ from the right ones."""
    unwound = got - 2.0 * np.pi * np.round((got - right) / (2.0 * np.pi))
    return np.where(
        np.abs(unwound - right) <= _TOLERANCE * np.maximum(1.0, np.abs(got)), unwound, got
    )


def _arguments(function: str) -> list[str]:
    return (CALLED[function].takes or '').split()
