"""The lab of the hills: a model, a PID and a relay; `bikeFE` and the PID are judged here.

In no test does the speed of the model pass through zero within a step, because sensible models
differ there: barc_sim's model holds the car at a standstill; the lab's equation does not.

Each term of the PID is judged alone, and the whole PID by its drive over the hills. Every common
form of a term is right. The integral can add each error, or the mean of two, with or without the
first, before or after it is used. The derivative can use the error or the measurement, with or
without a low-pass filter of first order, or a mean over five calls. The first outputs are not
judged. A positive constant factor, such as a missing dt, costs nothing and is mentioned: the gains
absorb it.
"""

from __future__ import annotations

from contextlib import suppress
from functools import cache, partial
from itertools import pairwise
from math import inf, isfinite
from random import Random
from typing import TYPE_CHECKING, NamedTuple, cast

import numpy as np

from barc_sim.control.speed import KD, KI, KP, PID, speed_controller
from barc_sim.errors import UserError
from barc_sim.lab import files
from barc_sim.lab.files import ChosenGains, ErrorKind, UserCodeError
from barc_sim.lab.judge import (
    Evidence,
    Finding,
    Functions,
    JudgedPart,
    Lab,
    Trial,
    TrialJudge,
    needs_person,
)
from barc_sim.lab.labs import relay
from barc_sim.lab.law import read_law
from barc_sim.simulation.closed_loop import Progress, closed_loop
from barc_sim.simulation.metrics import summary
from barc_sim.simulation.scenario import Scenario
from barc_sim.vehicle.bike_model import GRAVITY, L_F, L_R, Vehicle
from barc_sim.vehicle.plant import Plant

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from matplotlib.figure import Figure

    from barc_sim.lab.confined.process import JudgedCode
    from barc_sim.lab.judge import Index, Settings, Thresholds
    from barc_sim.lab.law import Floats, Mistake
    from barc_sim.simulation.log import Log


TS = 0.02  #: [s]
EQUATIONS = ('x_next', 'y_next', 'psi_next', 'v_next')  #: in the order in which bikeFE returns them
MODEL_LABELS = {
    'model.x': 'Model: position x',
    'model.y': 'Model: position y',
    'model.psi': 'Model: heading \N{GREEK SMALL LETTER PSI}',
    'model.v': 'Model: speed v',
}
_LAB = Vehicle()
BIKE = read_law(
    'bike.txt',
    GRAVITY=GRAVITY,
    MASS=_LAB.mass,
    DRAG=_LAB.air_drag_coeff,
    FRICTION=_LAB.friction,
    TS=TS,
    L_F=L_F,
    L_R=L_R,
)
FUNCTIONS = Functions(
    BIKE,
    results={'bikeFE': EQUATIONS},
    criteria=dict(zip(EQUATIONS, MODEL_LABELS, strict=True)),
    count=250,
    angles=('psi_next',),
)


Sample = tuple[float, float, float]  #: [m/s] reference, [m/s] measured, [s] since the last sample


def _outputs(code: JudgedCode, gains: Sequence[float], rows: Sequence[Sample]) -> list[float]:
    """Return the accelerations [m/s²] of a new `PID` for these samples in turn."""
    return code.steps('PID', code.make('PID', *gains), rows)


_MAX_OUTPUT = 1e6  #: [m/s²] of user code: no car can drive with more
_MAX_SPEED = 40.0  #: [m/s] The limit of the figure's speed axis.


@np.errstate(all='ignore')  # user code can return numbers of any size
def judge_lab_road(
    code: JudgedCode,
    gains: ChosenGains | None,
    thresholds: Thresholds,
    corrections: Mapping[str, float] | None = None,
) -> tuple[float, str, Evidence | None]:
    """Return score, message and evidence of the drive over the lab's road, stretch by stretch.

    A wrong term costs points only once: the user's PID drives with the terms in `corrections`
    corrected. Each value is the factor of the term's gain: -1 where only the sign is wrong, else 0,
    and then barc_sim's term replaces it. All else that is wrong with the user's PID stays as it is,
    so that no further mistake gives points.
    """
    if gains is None:
        _outputs(code, (0.0, 0.0, 0.0), [(0.0, 0.0, TS)])  # an error of PID itself comes first
        raise UserError(
            'controller.py chooses no gains: write the call PID(kp=…, ki=…, kd=…) with your tuned '
            'gains as its last line'
        )
    if not corrections:
        return _drive(_UserPid(code, gains), thresholds, gains)

    evidence = None
    with suppress(UserError):  # the figure shows the user's code
        _, _, evidence = _drive(_UserPid(code, gains), thresholds, gains)
    try:
        score, text = _drive_corrected(code, thresholds, gains, corrections)
    except UserError:  # the user's PID refuses a negative gain
        replaced_terms = dict.fromkeys(corrections, 0.0)
        score, text = _drive_corrected(code, thresholds, gains, replaced_terms)
    return score, f'with {" and ".join(corrections)} corrected: {text}', evidence


def _drive_corrected(
    code: JudgedCode, thresholds: Thresholds, gains: ChosenGains, corrections: Mapping[str, float]
) -> tuple[float, str]:
    """Drive with the user's PID and corrected terms; return score and message.

    Where the output has a limit, a replaced integral also drives without anti-windup, and the worse
    drive counts: it is unknown whether the user's right one would have it.
    """
    replaced = [name for name, factor in corrections.items() if not factor]
    limits = _limits_of(code, gains) if replaced else (-inf, inf)
    controller = _CorrectedPid(code, gains, corrections, limits)
    score, text, _ = _drive(controller, thresholds, gains)
    if 'I' not in replaced or not any(map(isfinite, limits)):
        return score, text

    controller = _CorrectedPid(code, gains, corrections, limits, winds_up=True)
    score_wound_up, text_wound_up, _ = _drive(controller, thresholds, gains)
    return _worse_drive((score, text), (score_wound_up, text_wound_up))


def _worse_drive(one: tuple[float, str], other: tuple[float, str]) -> tuple[float, str]:
    """Return score and message of the drive with the lower score.

    Of equal scores it is the one whose message comes first in the alphabet, so that the
    order of the two drives does not matter.
    """
    return min(one, other)


_PROBES = (1e4, 2e4)  #: [m/s] errors so large that any sensible limit of the output is reached


def _limits_of(code: JudgedCode, gains: ChosenGains) -> tuple[float, float]:
    """Return the limits [m/s²] of the user's output; infinite where there is none."""
    low = -inf
    high = inf
    for sign in (-1.0, 1.0):
        outputs = []
        for error in _PROBES:
            speeds = (error, 0.0) if sign > 0.0 else (0.0, error)
            with suppress(UserError):
                outputs.append(_outputs(code, gains.values, [(*speeds, TS)] * 3)[-1])
        is_limited = len(outputs) == len(_PROBES) and outputs[0] == outputs[1]
        if is_limited and outputs[0] < 0.0:
            low = outputs[0]
        elif is_limited and outputs[0] > 0.0:
            high = outputs[0]
    return low, high


def _drive(
    controller: PID, thresholds: Thresholds, gains: ChosenGains
) -> tuple[float, str, Evidence]:
    """Drive over the lab's road; return score, message and evidence."""
    progress = Progress(Scenario.distance)
    log = closed_loop(Plant(), controller, progress=progress)
    result = summary(log)
    limit = _limit_of(log)

    rms = result.rms_error_after_run_up
    maximum = result.max_error_after_run_up
    if progress.failure:
        score = 0.0
        text = progress.failure
        if isfinite(limit):
            text += f'; the maximum output is {limit:g} m/s²'
    else:
        score = thresholds.score(round(rms, 6), round(maximum, 6))
        text = (
            f'RMS error {rms:.3f} m/s after the first 10 m, maximum {maximum:.3f} m/s '
            f'(full marks up to {thresholds.full_rms:g} and {thresholds.full_max:g} m/s)'
        )
    text += f', with {gains}'

    changes = (np.flatnonzero(np.diff(log.theta_deg)) + 1).tolist()
    parts = [slice(begin, end) for begin, end in pairwise([0, *changes, len(log)])]
    remarks = [_stretch_remark(log, part, limit) for part in parts]
    stretches = [*zip(result.stretches, remarks, strict=True)]
    if score < 1.0:
        after_first = stretches[1:] or stretches
        worst, remark = max(after_first, key=lambda pair: pair[0].rms_error)
        text += f'. From {worst.start:.0f} m on, at {worst.theta_deg:g}°: {remark}'

    rows = [
        (
            f'{stretch.start:.0f} m',
            f'{stretch.theta_deg:g}°',
            f'{stretch.rms_error:.3f} m/s',
            f'{stretch.max_error:.3f} m/s',
            remark,
        )
        for stretch, remark in stretches
    ]
    header = ('from', 'grade', 'RMS', 'maximum', 'remark')
    title = "the lab's road, stretch by stretch"
    return score, text, Evidence(title, header, rows, partial(_figure, log))


def _limit_of(log: Log) -> float:
    """Return the limit [m/s²] at which the output stays for long; infinite if there is none."""
    size = np.abs(log.motor)
    maximum = float(size.max())
    at_maximum = np.concatenate([[0], size == maximum, [0]])
    changes = np.flatnonzero(np.diff(at_maximum))
    durations = np.diff(changes)[::2]
    return maximum if maximum and durations.max(initial=0) > _LONG else inf


def _figure(log: Log, title: str = '') -> Figure:
    """Draw the run beside the run of barc_sim's controller."""
    from barc_sim.figures.run_figures import plot  # noqa: PLC0415 (slow)

    figure = cast('Figure', plot(log, _reference_run(), labels=['your PID', "barc_sim's PID"]))
    speed = figure.axes[0]
    low, high = speed.get_ylim()
    speed.set_ylim(max(low, -_MAX_SPEED), min(high, _MAX_SPEED))
    speed.set_title(title, loc='left', pad=26.0)
    return figure


@cache
def _reference_run() -> Log:
    """Return the run with barc_sim's controller."""
    return closed_loop(controller=speed_controller(limit=inf))


class _UserPid(PID):
    """Drives with a user's PID, which its process calls."""

    def __init__(self, code: JudgedCode, gains: ChosenGains) -> None:
        super().__init__()
        self._code = code
        self._pid = code.make('PID', *self._passed(gains))
        self._gains = gains
        self.calls = 0

    def _passed(self, gains: ChosenGains) -> Sequence[float]:
        """Return the gains that the user's PID gets."""
        return gains.values

    def acc_calculate(
        self, speed_reference: float, speed_current: float, dt: float | None = None
    ) -> float:
        """Return the acceleration [m/s²]; an error names the call."""
        where = f'call {self.calls + 1}, after {self.calls * TS:.2f} s on the road'
        self.calls += 1
        try:
            row = (speed_reference, speed_current, dt or TS)
            output = self._code.steps('PID', self._pid, [row])[0]
        except UserError as error:
            if isinstance(error, UserCodeError) and error.kind is ErrorKind.NOT_WRITTEN:
                raise
            raise UserError(f'{where}: {error} (with {self._gains})') from error
        if abs(output) > _MAX_OUTPUT:
            text = f'it returned {output:.3g} m/s²; expected at most {_MAX_OUTPUT:g}'
            raise UserError(f'{where}: {text} (with {self._gains})')
        return output


class _CorrectedPid(_UserPid):
    """Drives with a user's PID in which some terms are corrected.

    A term of the wrong sign gets its gain with the opposite sign. Any other wrong term gets the
    gain 0, and barc_sim's takes its place, within the limits of the user's output. If it
    `winds_up`, the integral of barc_sim grows on at these limits, as one without anti-windup.
    """

    def __init__(
        self,
        code: JudgedCode,
        gains: ChosenGains,
        corrections: Mapping[str, float],
        limits: tuple[float, float],
        *,
        winds_up: bool = False,
    ) -> None:
        self._factors = [corrections.get(name, 1.0) for name in 'PID']
        super().__init__(code, gains)
        ours = [
            gain if corrections.get(name) == 0.0 else 0.0
            for gain, name in zip(gains.values, 'PID', strict=True)
        ]
        self._ours = PID(*ours)
        self._limits = limits
        self._winds_up = winds_up

    def _passed(self, gains: ChosenGains) -> Sequence[float]:
        return [gain * factor for gain, factor in zip(gains.values, self._factors, strict=True)]

    def acc_calculate(
        self, speed_reference: float, speed_current: float, dt: float | None = None
    ) -> float:
        """Return the acceleration [m/s²]; an error names the call."""
        theirs = super().acc_calculate(speed_reference, speed_current, dt)
        low, high = self._limits
        if not self._winds_up:
            self._ours.output_min = low - theirs
            self._ours.output_max = high - theirs
        ours = self._ours.acc_calculate(speed_reference, speed_current, dt or TS)
        return min(max(theirs + ours, low), high)


_BACKWARDS = 'the car drives backwards: is the error speed_reference - speed_current?'
_NEGLIGIBLE = 0.05  #: [m/s] Smaller errors are not mentioned.
_LONG = 25  #: calls; code that returns its maximum output for longer has a limit
_MIN_SWINGS = 4  #: fewer are not mentioned
_SWING = 0.3  #: share of the maximum error that each swing reaches


def _stretch_remark(log: Log, part: slice, limit: float) -> str:
    """Return what the speed does on a stretch, as measured; advice would be a guess."""
    error = log.speed_error[part]
    maximum = float(np.abs(error).max())
    remarks = []
    if not part.start and log.speed[part].min() < -_NEGLIGIBLE:
        remarks.append(_BACKWARDS)

    large = error[np.abs(error) > max(_SWING * maximum, _NEGLIGIBLE)]
    swings = np.count_nonzero(np.diff(np.sign(large)))
    if swings >= _MIN_SWINGS:
        remarks.append(f'the speed swings {swings} times')

    at_limit = np.count_nonzero(np.abs(log.motor[part]) >= limit)
    if at_limit > 1 and maximum > _NEGLIGIBLE:
        remarks.append(f'the output was at its limit of {limit:g} m/s² for {at_limit * TS:.1f} s')

    final = round(float(np.mean(error[-max(len(error) // 5, 1) :])), 2)
    deviation = 'no error'
    if final:
        deviation = f'{abs(final):.2f} m/s too {"slow" if final > 0.0 else "fast"}'
    remarks.append(f'{deviation} at the end')
    return '; '.join(remarks)


PID_LABELS = {
    'pid.proportional': 'PID: proportional term',
    'pid.integral': 'PID: integral term',
    'pid.derivative': 'PID: derivative term',
    'loop.lab_road': "Cruise control: the lab's road",
}


def _before(values: Floats) -> Floats:
    """Return the values of the previous call; at the first call, its own value."""
    return np.concatenate([values[:, :1], values[:, :-1]], axis=1)


def _last(values: Floats, count: int) -> list[Floats]:
    """Return the values of a call, of the call before, and so on."""
    return [values, *_last(_before(values), count - 1)] if count else []


PID_LAW = read_law('pid.txt', {'total': partial(np.cumsum, axis=-1), 'before': _before})


def judge_pid(code: JudgedCode, settings: Settings) -> Iterator[Finding]:
    """Yield a finding for each criterion of `controller.py`."""
    # The file is loaded with its first object; only then are its gains known. An error in it comes
    # again below, as a finding.
    with suppress(UserError):
        code.make('PID', KP, KI, KD)
    gains = code.chosen_gains()

    terms = judge_terms(code, settings.seed, settings.points)
    yield from terms.findings

    if gains is None and terms.ignores_gains:
        gains = ChosenGains(KP, KI, KD, 'which have no effect')
    score, text, evidence = judge_lab_road(code, gains, settings.thresholds, terms.corrections)
    if gains and terms.ignores_gains:  # its fixed gains may be better than the chosen ones
        chosen_score, chosen_text, _ = _drive(PID(*gains.values), settings.thresholds, gains)
        score, text = _worse_drive((score, text), (chosen_score, chosen_text))
    yield Finding('loop.lab_road', score, text, evidence)


class Term(NamedTuple):
    """A term of the PID, judged alone: the other gains are 0."""

    criterion: str
    name: str  #: P, I or D
    gains: tuple[float, float]
    amplitude: float  #: [m/s] maximum error, for a gain of 1
    max_sum: float = inf  #: [m/s] maximum sum of the errors

    def trial(self, code: JudgedCode, seed: int, kp: float = 0.0) -> Trial:
        """Return the trial of the term; its outputs have a row for each gain, a column a call.

        With `kp` they are the outputs with this gain of P, minus those of P alone.
        """
        sequences = self._sequences(seed)
        gains = self._gains()
        p_alone = [kp, 0.0, 0.0]

        outputs = np.full(np.shape(sequences)[:2], np.nan)
        failure = ''
        with np.errstate(all='ignore'):
            try:
                calls = zip((gains + p_alone).tolist(), sequences, strict=True)
                outputs = np.array([_outputs(code, row, sequence) for row, sequence in calls])
                if kp:
                    outputs -= np.array([_outputs(code, p_alone, each) for each in sequences])
            except UserError as error:
                if needs_person(error):
                    raise
                failure = str(error)

        return self._trial(seed, outputs, failure)

    def trial_with(self, mistake: Mistake, seed: int) -> Trial:
        """Return the trial of a term that is right but for a mistake of the law."""
        right = self._trial(seed, np.array([]))
        wrong = PID_LAW.compute(right.inputs, mistake.formulas)[self.name]
        return right._replace(got={self.name: np.broadcast_to(wrong, right.right[self.name].shape)})

    def _trial(self, seed: int, outputs: Floats, failure: str = '') -> Trial:
        reference, measured, dt = np.array(self._sequences(seed)).transpose(2, 0, 1)
        inputs = {'reference': reference, 'measured': measured, 'dt': dt}
        gains = self._gains()
        for k, name in enumerate(('kp', 'ki', 'kd')):
            inputs[name] = gains[:, k, np.newaxis]
        return Trial(
            function='PID',
            name=self.criterion,
            tests=self.name,
            inputs=inputs,
            right=PID_LAW.compute(inputs),
            got={self.name: outputs},
            failure=failure,
        )

    def _sequences(self, seed: int) -> list[list[Sample]]:
        """Return the samples for each gain."""
        return [
            wandering(seed, f'{self.criterion} {gain}', self.amplitude / gain, self.max_sum)
            for gain in self.gains
        ]

    def _gains(self) -> Floats:
        """Return a row for each gain, of P, I and D."""
        gains = np.zeros((len(self.gains), 3))
        gains[:, 'PID'.index(self.name)] = self.gains
        return gains


# Outputs stay below 2 m/s², even with a missing dt, so that no limit in user code changes them.
TERMS = (
    Term('pid.proportional', 'P', (0.5, 30.0), 1.5),
    # The sum of the errors stays far below any sensible limit of the integral.
    Term('pid.integral', 'I', (0.5, 200.0), 0.05, max_sum=1.0),
    Term('pid.derivative', 'D', (0.1, 3.0), 0.75 * TS),
)
_LENGTH = 120  #: calls of a sequence
_TOLERANCE = 1e-9  #: [m/s²]
_RELATIVE = 1e-7
_HALF = 0.5
_MAX_KEPT = 0.99  #: share of its last output that a low-pass filter may keep
_CHANGES = 5  #: whose mean D may use


def wandering(seed: int, name: str, amplitude: float, max_sum: float = inf) -> list[Sample]:
    """Return samples with random errors up to ±`amplitude` [m/s], and a reference that changes.

    All errors are scaled down if their sum would exceed `max_sum` [m/s].
    """
    uniform = Random(f'{seed} {name}').uniform  # noqa: S311 (a simulation, not a secret)
    error = amplitude * np.array([uniform(-1.0, 1.0) for _ in range(_LENGTH)])
    error[40:60] = amplitude * uniform(0.5, 1.0)  # a constant error for a while
    steps = [uniform(-0.5, 0.5) for _ in range(4)]
    reference = 8.0 + amplitude * np.repeat(steps, _LENGTH // 4)
    largest_sum = float(np.abs(np.cumsum(error)).max())
    measured = reference - error * min(1.0, max_sum / largest_sum)
    return [(r, v, TS) for r, v in zip(reference.tolist(), measured.tolist(), strict=True)]


def _fitted(got: Floats, *columns: Floats) -> list[float]:
    """Return the coefficients with which the columns sum to the outputs; empty if none do.

    The first seven calls do not count.
    """
    values = np.stack(columns, -1)[:, 7:].reshape(-1, len(columns))
    outputs = got[:, 7:].ravel()
    scale = np.abs(values).max(0)
    if not (np.all(scale) and 0.0 < np.abs(outputs).max() < _MAX_OUTPUT):
        return []

    solution = np.linalg.lstsq(values / scale, outputs, rcond=None)[0] / scale
    residual = np.abs(outputs - values @ solution).max()
    coefficients: list[float] = solution.tolist()
    return coefficients if residual <= _RELATIVE * np.abs(outputs).max() else []


def agree(got: Floats, form: Floats) -> bool:
    """Return whether outputs are the same, up to a positive factor."""
    factors = _fitted(got, np.broadcast_to(form, got.shape))
    return factors[0] > 0.0 if factors else not (np.any(got[:, 1:]) or np.any(form[:, 1:]))


def factor_of(trial: Trial) -> float:
    """Return the factor between the outputs and the formula's term; 0 if they are another term.

    P must be the error. The growth of I must be a sum of the last three errors with coefficients of
    at least 0: so I may add each error, or the mean of two, before or after it is used. D must be
    the change of the error or of the measurement, also through a low-pass filter of first order, or
    over several calls.
    """
    name = next(iter(trial.got))
    inputs = trial.inputs
    outputs = trial.got[name] / inputs[f'k{name.lower()}']
    v = inputs['measured']
    e = inputs['reference'] - v
    if name == 'P':
        return max(sum(_fitted(outputs, e)), 0.0)
    if name == 'I':
        factors = _fitted(outputs - _before(outputs), *_last(e * TS, 3))
        is_sum = factors and min(factors) >= -_RELATIVE * max(factors)
        return sum(factors) if is_sum else 0.0

    for x in (e, -v):
        change = (x - _before(x)) / TS
        filtered = _fitted(outputs, change, _before(outputs))
        if filtered:
            factor, share_kept = filtered
            if factor > 0.0 and -_RELATIVE * factor <= share_kept < _MAX_KEPT:
                return factor / (1.0 - share_kept)
        factors = _fitted(outputs, *_last(change, _CHANGES))
        if factors and factors[0] > 0.0 and sum(factors) > _RELATIVE:
            return sum(factors)
    return 0.0


class _Terms(TrialJudge):
    """Judges the terms of the PID: every common form of a term is right."""

    def is_right(self, trial: Trial, _: str) -> bool:
        """Return whether a term is right up to a factor, which the gain absorbs."""
        return factor_of(trial) > 0.0

    def _call(self, trial: Trial, index: Index) -> str:
        row, k = index
        error = (trial.inputs['reference'] - trial.inputs['measured'])[row]
        gain = max(float(trial.inputs[name][row, 0]) for name in ('kp', 'ki', 'kd'))
        before = f' after {error[k - 1]:.6g}' if k else ''
        return f'call {k + 1}, with a gain of {gain:g} and e = {error[k]:.6g} m/s{before},'

    def _line(
        self, code: JudgedCode, trial: Trial, _: str, index: Index, wrong: list[float]
    ) -> str:
        row, k = index
        samples = np.stack([trial.inputs[key][row] for key in ('reference', 'measured', 'dt')], -1)
        gains = [float(trial.inputs[key][row, 0]) for key in ('kp', 'ki', 'kd')]
        pid = code.make('PID', *gains)
        code.steps('PID', pid, samples[:k].tolist())
        call = samples[k].tolist()
        return code.line_of('steps', ('PID', pid, [call]), wrong, call)


TERM_JUDGE = _Terms(PID_LAW, agree, min_loss=_HALF)

_KP = (
    'kp multiplies this term, too: the output is '
    'kp * e + ki * (sum of e * dt) + kd * (change of e) / dt'
)
_KP_COSTS = 0.5 * _HALF
# Gains of two PIDs that get the same samples.
_SMALL_GAINS = (1.0, 0.5, 0.1)
_LARGE_GAINS = (3.0, 2.0, 0.7)
_RANDOM = 'the same speeds give different outputs: does PID use random numbers? As a result: '
_IGNORED = (
    'the gains that PID gets have no effect: it uses fixed numbers. Store kp, ki and kd in '
    '__init__, and use them'
)


class JudgedTerms(NamedTuple):
    """What is found in the terms of a PID."""

    findings: list[Finding]  #: one for each term
    corrections: Mapping[str, float] = {}  #: the terms to correct, as `judge_lab_road` takes them
    ignores_gains: bool = False  #: whether the PID uses fixed numbers in place of its gains


@np.errstate(all='ignore')
def judge_terms(
    code: JudgedCode, seed: int, points: Mapping[str, float] | None = None
) -> JudgedTerms:
    """Judge each term of the PID alone.

    With a wrong term, random outputs are mentioned. A term that never changes is not corrected: the
    car drives with it, or without it if it is 0.
    """
    rows = wandering(seed, 'gains', 0.01)
    random = ''
    with suppress(UserError):
        outputs = _outputs(code, _SMALL_GAINS, rows)
        again = _outputs(code, _SMALL_GAINS, rows)
        with_large_gains = _outputs(code, _LARGE_GAINS, rows)
        if outputs == with_large_gains and any(outputs):
            return JudgedTerms(_with_fixed_gains(outputs, rows), ignores_gains=True)
        random = '' if np.allclose(outputs, again, rtol=0.0, atol=_TOLERANCE) else _RANDOM

    trials = [term.trial(code, seed) for term in TERMS]
    scaled = {
        term.name
        for term, trial in zip(TERMS, trials, strict=True)
        if not trial.got[term.name].any() and _is_scaled_by_kp(code, term.name, rows)
    }
    trials = [
        term.trial(code, seed, kp=1.0) if term.name in scaled else trial
        for term, trial in zip(TERMS, trials, strict=True)
    ]

    points = points or {}
    weights = {term.name: points.get(term.criterion, 1.0) for term in TERMS}
    verdicts = TERM_JUDGE.verdicts(code, trials, weights)

    findings = []
    corrections = {}
    for trial in trials:
        name = next(iter(trial.got))
        score, mistake = verdicts[name]
        message = mistake
        if name in scaled:
            score = max(score - _KP_COSTS, 0.0)
            message = '; '.join(filter(None, (_KP, mistake)))
        is_constant = not np.ptp(trial.got[name], axis=-1).any()
        if score < 1.0 and not (is_constant or trial.failure):
            negated = trial._replace(got={name: -trial.got[name]})
            is_negative = name not in scaled and factor_of(negated) > 0.0
            corrections[name] = -1.0 if is_negative else 0.0
        if message:
            text = f'{random}{message}'
        else:
            text = f'right in all {trial.got[name].size} outputs{_remark(name, factor_of(trial))}'
        findings.append(Finding(trial.name, score, text))
    return JudgedTerms(findings, corrections)


def _with_fixed_gains(outputs: Sequence[float], rows: Sequence[Sample]) -> list[Finding]:
    """Return a finding for each term of a PID that ignores its gains.

    A term that is missing or has the wrong sign gets no points, if the PID has the lab's form.
    """
    is_a_pid = len({*map(abs, outputs)}) > _LENGTH // 2 and max(outputs) < _MAX_OUTPUT

    reference, measured, dt = np.array(rows).T
    e = (reference - measured)[np.newaxis]
    change = e - _before(e)
    factors = _fitted(np.array([outputs]), e, np.cumsum(e * dt, axis=1), change / dt)
    has_terms = [factor > _TOLERANCE for factor in factors] or [True] * len(TERMS)
    return [
        Finding(term.criterion, _HALF * (is_a_pid and has_term), _IGNORED)
        for term, has_term in zip(TERMS, has_terms, strict=True)
    ]


def _is_scaled_by_kp(code: JudgedCode, name: str, rows: Sequence[Sample]) -> bool:
    """Return whether a term has an effect with kp = 1, though it is 0 with kp = 0."""
    p_alone = (1.0, 0.0, 0.0)
    with_term = (1.0, 1.0 * (name == 'I'), 1.0 * (name == 'D'))
    with suppress(UserError):
        return _outputs(code, with_term, rows) != _outputs(code, p_alone, rows)
    return False


def _remark(name: str, factor: float) -> str:
    """Return a remark if a right term differs from the formula by a factor, else nothing."""
    if abs(factor - 1.0) <= _RELATIVE:
        return ''
    no_dt = {'I': (1.0 / TS, 'add up ki * e * dt'), 'D': (TS, 'divide the change of e by dt')}
    missing, advice = no_dt.get(name, (0.0, ''))
    if abs(factor - missing) <= _RELATIVE * missing:
        return f'; {name} has no dt: {advice}, with dt = {TS:g} s, or choose gains that absorb it'
    return f'; {name} is {factor:.6g} times the formula: is dt right? The gain absorbs the factor'


def judge_model(code: JudgedCode, settings: Settings) -> list[Finding]:
    """Return a finding for each criterion of `bike_model.py`."""
    findings, _ = FUNCTIONS.judge(code, settings.seed, settings.points)
    return findings


HILLS = Lab(
    files.HILLS,
    {
        'model': JudgedPart(MODEL_LABELS, judge_model),
        'controller': JudgedPart(PID_LABELS, judge_pid),
        'relay': JudgedPart(relay.LABELS, lambda code, _: relay.judge_relay(code)),
    },
)
