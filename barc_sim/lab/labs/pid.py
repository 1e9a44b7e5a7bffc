"""Judges a `PID`: each term alone, what it keeps between calls, and its drives over the hills.

Every common form of a term is right. The integral can add an error, or the mean of two, with or
without the first, before or after it is used. The derivative can use the error or the measurement,
with or without a low-pass filter of first order. The first output is not judged. A positive
constant factor, such as a missing dt, is right and remarked upon: the gains absorb it. `pid.dt`
judges it.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cache, partial
from itertools import count, pairwise
from math import inf, isfinite
from pathlib import Path
from random import Random
from typing import TYPE_CHECKING, Any, NamedTuple, cast

import numpy as np

from barc_sim.control.driver import RATE, STALE_AFTER
from barc_sim.control.speed import ACCELERATION_LIMIT, KD, KI, KP, PID, speed_controller
from barc_sim.errors import UserError
from barc_sim.lab.judge import Finding, JudgedCode, Table, Thresholds, judges, numbers_of, rows_of
from barc_sim.lab.laws import Judge, Trial, read
from barc_sim.lab.user_code.folder import MAX_COMMANDS, NOT_WRITTEN, Command, TimedTwist
from barc_sim.lab.user_code.source import ChosenGains
from barc_sim.simulation.closed_loop import DISTANCE, MAX_DURATION, Progress, closed_loop
from barc_sim.simulation.metrics import SegmentErrors, summary
from barc_sim.vehicle.bike_model import GRAVITY, L_F, L_R
from barc_sim.vehicle.plant import Plant
from barc_sim.vehicle.road import Road

if TYPE_CHECKING:
    from collections.abc import Collection, Iterator, Mapping, Sequence

    from matplotlib.figure import Figure

    from barc_sim.lab.judge import Judged, Settings
    from barc_sim.lab.laws import Floats, Index
    from barc_sim.simulation.log import Log

    Gains = tuple[float, float, float]  # kp, ki, kd


TS = 0.02  #: [s]
Next = tuple[float, float, float, float]  #: x, y, psi, v one step later
Sample = tuple[float, float, float]  #: [m/s] reference, [m/s] measured, [s] since the last
#: The user's name for what a request calls; others call a PID.
_CALLED = {'functions': 'bikeFE', 'relay_commands': 'relay', 'notes': 'notes'}
_STATE = 4  # numbers
_numbers = count()  # of the controllers


class HillsCode(JudgedCode):
    """A user's model, controller and relay."""

    def called(self, do: str, *_: Any) -> str:  # noqa: ANN401 (JSON)
        """Return the user's name for what a request calls."""
        return _CALLED.get(do, 'PID')

    def bike_fe(
        self, rows: Sequence[Sequence[float]], l_f: float = L_F, l_r: float = L_R
    ) -> list[Next]:
        """Return the result of `bikeFE` for each row of its arguments.

        Lengths [m] that are not the lab's are passed if it takes them, and replace the file's own.
        """
        request = self.request(rows, l_f, l_r)
        if (l_f, l_r) == (L_F, L_R):
            request = request[:-1]
        return rows_of('bikeFE', self.call('functions', *request), len(rows), _STATE)

    @staticmethod
    def request(rows: Sequence[Sequence[float]], l_f: float, l_r: float) -> tuple[Any, ...]:
        """Return the arguments of a request for `bikeFE`, whose file gets these lengths, too."""
        return 'bikeFE', rows, {'l_f': l_f, 'l_r': l_r}, {'lf': l_f, 'lr': l_r}

    def new_pid(
        self, kp: float, ki: float, kd: float, *, limit: float = inf, fresh: bool = True
    ) -> JudgedController:
        """Return a new `PID` with these gains.

        It gets the `limit` [m/s²] of its output if it takes one. With `fresh` its file is loaded
        again, so that no global variable has a value of an earlier run.
        """
        number = next(_numbers)
        self.call('make_pid', number, kp, ki, kd, limit, fresh)
        return JudgedController(self, number)

    def relay_commands(self, twists: Sequence[TimedTwist], duration: float) -> list[Command]:
        """Return what a new relay commands from 0 to `duration` [s], while it gets `twists`."""
        found = self.call('relay_commands', twists, duration, _relay_calls(twists, duration))
        rows = min(len(found), MAX_COMMANDS) if isinstance(found, list) else -1
        return [Command(*row) for row in rows_of('relay', found, rows, len(Command._fields))]


class JudgedController:
    """One instance of the user's `PID`."""

    def __init__(self, code: HillsCode, number: int) -> None:
        """Refer to the controller `number` of `code`."""
        self._code, self.number = code, number

    def acc_calculate(self, reference: float, current: float, dt: float, /) -> float:
        """Return the commanded acceleration [m/s²]."""
        return self.acc_sequence([(reference, current, dt)])[0]

    def acc_sequence(self, rows: Sequence[Sample], /) -> list[float]:
        """Return the results of `acc_calculate` for one sample after the other."""
        found = self._code.call('steps', self.number, rows)
        return numbers_of('PID', found, len(rows))

    def reset(self) -> bool:
        """Call the user's `reset()`; return False if the class has none."""
        return self._code.call('reset', self.number) is True


def _relay_calls(twists: Sequence[TimedTwist], duration: float) -> list[TimedTwist]:
    """Return the calls of a function `relay`, as its node makes them: zeros after stale Twists."""
    calls, nothing = [], TimedTwist(-inf, 0.0, 0.0)
    for k in range(round(duration * RATE)):
        t = k * (1.0 / RATE)
        latest = max((each for each in twists if each.t <= t + 1e-9), default=nothing)
        used = latest if t - latest.t <= STALE_AFTER else nothing
        calls.append(used._replace(t=t))
    return calls


STEEPEST_DEG = 25.0
NOT_A_CAR = 1e6  #: [m/s²]
_RANDOM_ROADS = 4
_GRADES = 5
_MIN_LENGTH, _MAX_LENGTH = 15.0, 30.0  #: [m] of a grade
_MAX_SPEED = 40.0  #: [m/s] A figure ends there.


def random_road(seed: int, number: int) -> tuple[Road, float]:
    """Return random road `number` and its length [m]: 20 m on the flat, then five grades.

    The car's motor can climb each of them.
    """
    random = Random(f'{seed} road {number}')  # noqa: S311 (a simulation, not a secret)
    starts, grades = [0.0], [0.0]
    end = 20.0
    for _ in range(_GRADES):
        starts.append(end)
        grades.append(round(random.uniform(-STEEPEST_DEG, STEEPEST_DEG), 1))
        end = round(end + random.uniform(_MIN_LENGTH, _MAX_LENGTH), 1)
    return Road(tuple(starts), tuple(grades), name=f'random {number + 1}'), end


@dataclass(frozen=True)
class Conditions:
    """How a controller drives."""

    gains: ChosenGains | None  #: None: it chooses none
    thresholds: Thresholds = field(default_factory=Thresholds)
    mended: str = ''  #: letters of terms that barc_sim's replace, as in `PI`

    def __str__(self) -> str:
        """Return them as text."""
        return f'with {self.gains}'


@judges('loop.lab_road')
def judge_lab_road(code: HillsCode, conditions: Conditions) -> Judged:
    """Return the finding for the lab's road, with what the speed does on each stretch of it."""
    try:
        drive = _drive(code, conditions, Road.lab(), DISTANCE)
    except UserError as error:
        if NOT_WRITTEN in str(error) or not conditions.gains:
            raise
        raise UserError(f'{error} ({conditions})') from error
    message = f'{drive.describe()}, {conditions}{drive.worst_stretch()}'
    return drive.score, message, drive


@cache
def _usual() -> Log:
    """Return the run with barc_sim's controller."""
    return closed_loop(controller=speed_controller(limit=inf), distance=DISTANCE)


@judges('loop.random_roads')
def judge_random_roads(code: HillsCode, conditions: Conditions, seed: int) -> Judged:
    """Return the finding for random roads: the mean of their scores."""
    roads = (random_road(seed, number) for number in range(_RANDOM_ROADS))
    drives = [_drive(code, conditions, *road) for road in roads]
    worst = min(drives, key=lambda drive: drive.score)
    message = f'the worst of {len(drives)} roads: {worst.describe()}{worst.worst_stretch()}'
    return float(np.mean([drive.score for drive in drives])), message


class _Mended(PID):
    """A user's controller; terms of barc_sim's PID take the place of some."""

    def __init__(self, code: HillsCode, conditions: Conditions) -> None:
        assert conditions.gains  # noqa: S101 (there are some)
        gains = dict(zip('PID', conditions.gains[:3], strict=True))
        own = [0.0 if name in conditions.mended else gain for name, gain in gains.items()]
        super().__init__()  # a user's gains have no limits
        self.kp, self.ki, self.kd = (
            gain - mine for gain, mine in zip(gains.values(), own, strict=True)
        )
        self._controller = code.new_pid(*own)
        self.calls = 0

    def acc_calculate(
        self, speed_reference: float, speed_current: float, dt: float | None = None
    ) -> float:
        """Return the acceleration [m/s²]."""
        self.calls += 1
        dt = self.dt if dt is None else dt
        output = self._controller.acc_calculate(speed_reference, speed_current, dt)
        output += super().acc_calculate(speed_reference, speed_current, dt)
        if abs(output) > NOT_A_CAR:
            raise UserError(
                f'it returned {output:.3g} m/s²: beyond {NOT_A_CAR:g} it is not a car'
                + (f'; {_BACKWARDS}' if speed_current < -_HELD else '')
            )
        return output


def _drive(code: HillsCode, conditions: Conditions, road: Road, distance: float) -> Drive:
    """Drive over a road; what follows from a wrong term is not taken off again.

    So the code drives with its wrong terms put right, too, and the better drive counts.
    """
    if conditions.gains is None:
        code.new_pid(0.0, 0.0, 0.0).acc_calculate(0.0, 0.0, TS)  # its own error, if there is one
        raise UserError(
            'controller.py chooses no gains: write the call PID(kp=…, ki=…, kd=…) with the tuned '
            'ones as its last line'
        )
    drives = []
    try:
        drives.append(_driven(code, replace(conditions, mended=''), road, distance))
    except UserError:
        if not conditions.mended:
            raise
    if conditions.mended:
        drives.append(_driven(code, conditions, road, distance))
    return max(drives, key=lambda drive: drive.score)


def _driven(
    code: HillsCode,
    conditions: Conditions,
    road: Road,
    distance: float,
    duration: float = MAX_DURATION,
) -> Drive:
    """Drive over a road once; an error of the code on the way names the call."""
    plant = Plant(road=road)
    pid = _Mended(code, conditions)
    progress = Progress(distance)
    try:
        log = closed_loop(plant, pid, distance=distance, max_duration=duration, progress=progress)
    except UserError as error:
        if NOT_WRITTEN in str(error):
            raise
        time = (pid.calls - 1) * plant.ts
        raise UserError(f'call {pid.calls}, after {time:.2f} s on the road: {error}') from error
    return Drive(log, progress.failure, conditions)


@dataclass(frozen=True)
class Drive:
    """A drive over one road with the user's controller."""

    log: Log
    failure: str  #: what the car does that never arrives
    conditions: Conditions

    @property
    def errors(self) -> tuple[float, float]:
        """The RMS and the maximum error [m/s] after the run-up."""
        result = summary(self.log)
        return round(result.rms_error_after_run_up, 6), round(result.max_error_after_run_up, 6)

    @property
    def limit(self) -> float:
        """The limit [m/s²] of the output, at which it stays for long; infinite if there is none."""
        size = np.abs(self.log.motor)
        at_limit = np.concatenate([[0], size == size.max(), [0]])
        times = np.diff(np.flatnonzero(np.diff(at_limit)))[::2]
        return float(size.max()) if times.max(initial=0) > _OWN_LIMIT and size.max() else inf

    @property
    def score(self) -> float:
        """The score, from 0 to 1."""
        if self.failure:
            return 0.0
        return self.conditions.thresholds.score(*self.errors)

    def describe(self) -> str:
        """Return a sentence on the errors."""
        if self.failure:
            limit = f'; its output is {self.limit:g} m/s² at most' if isfinite(self.limit) else ''
            return f'{self.failure}{limit}'
        (rms, maximum), by = self.errors, self.conditions.thresholds
        mended = self.conditions.mended
        return (
            (f'with {" and ".join(mended)} put right: ' if mended else '')
            + f'RMS error {rms:.3f} m/s after the first 10 m, at most {maximum:.3f} m/s '
            f'({by.full_rms:g} and {by.full_max:g} m/s are full marks)'
        )

    @property
    def stretches(self) -> list[tuple[SegmentErrors, str]]:
        """The errors on each stretch of one grade, and what the speed does there."""
        changes = np.flatnonzero(np.diff(self.log.theta_deg)) + 1
        parts = [slice(*each) for each in pairwise([0, *changes.tolist(), len(self.log)])]
        remarks = (_stretch_remark(self.log, part, self.limit) for part in parts)
        return [*zip(summary(self.log).stretches, remarks, strict=True)]

    @property
    def table(self) -> Table:
        """The stretches, as text."""
        header = ('from', 'grade', 'RMS', 'at most', 'the speed')
        rows = [
            (
                f'{errors.start:.0f} m',
                f'{errors.theta_deg:g}°',
                f'{errors.rms_error:.3f} m/s',
                f'{errors.max_error:.3f} m/s',
                remark,
            )
            for errors, remark in self.stretches
        ]
        return Table("the lab's road, stretch by stretch", header, rows)

    def worst_stretch(self) -> str:
        """Return a sentence on the stretch with the largest RMS error; empty at full marks."""
        if self.score == 1.0:
            return ''
        first, *later = self.stretches
        worst, remark = max(later or [first], key=lambda stretch: stretch[0].rms_error)
        return f'. From {worst.start:.0f} m on, at {worst.theta_deg:g}°: {remark}'

    def figure(self, title: str = '') -> Figure:
        """Draw the run beside that with barc_sim's controller."""
        from barc_sim.figures.run_figures import plot  # noqa: PLC0415 (slow)

        runs = {'your PID': self.log, "barc_sim's PID": _usual()}
        figure = cast('Figure', plot(*runs.values(), labels=[*runs]))
        speed = figure.axes[0]
        low, high = speed.get_ylim()
        speed.set_ylim(max(low, -_MAX_SPEED), min(high, _MAX_SPEED))
        speed.set_title(title, loc='left', pad=26.0)
        return figure


_BACKWARDS = 'the car drives backwards: is the error speed_reference - speed_current?'
_HELD = 0.05  #: [m/s] An error up to this is negligible.
_OWN_LIMIT = 25  #: calls: code that returns its largest output for longer has a limit of its own
_SWINGS, _SWING = 4, 0.3  #: how many count, and the share of the maximum error that one reaches


def _stretch_remark(log: Log, part: slice, limit: float) -> str:
    """Return what the speed does on a stretch: what was measured, and no advice."""
    error, remarks = log.speed_error[part], []
    if part.start:
        slopes = np.sin(np.radians(log.theta_deg[[part.start - 1, part.start]]))
        change = GRAVITY * float(np.diff(slopes)[0])
        remarks.append(f'needs {abs(change):.1f} m/s² {"more" if change > 0.0 else "less"} at once')
    elif log.speed[part].min() < -_HELD:
        remarks.append(_BACKWARDS)
    large = error[np.abs(error) > max(_SWING * float(np.abs(error).max()), _HELD)]
    if (swings := np.count_nonzero(np.diff(np.sign(large)))) >= _SWINGS:
        remarks.append(f'the speed swings {swings} times')
    at_limit = np.count_nonzero(np.abs(log.motor[part]) >= limit)
    if at_limit > 1 and np.abs(error).max() > _HELD:
        remarks.append(f'the output was at its limit of {limit:g} m/s² for {at_limit * TS:.1f} s')
    rest = float(np.mean(error[-max(len(error) // 5, 1) :]))
    remarks.append(f'{abs(rest):.2f} m/s too {"slow" if rest > 0.0 else "fast"} at its end')
    return '; '.join(remarks)


LABELS = {
    'pid.proportional': 'PID: proportional term',
    'pid.integral': 'PID: integral term',
    'pid.derivative': 'PID: derivative term',
    'pid.dt': 'PID: the time step',
    'pid.windup': 'PID: integral at the limit',
    'pid.reset': 'PID: fresh start of a new run',
    'loop.lab_road': "Cruise control: the lab's road",
    'loop.random_roads': 'Cruise control: other roads',
}


def _total(values: Floats) -> Floats:
    """Return the sums up to each call."""
    return np.cumsum(values, axis=-1)


def _before(values: Floats, calls: int = 1) -> Floats:
    """Return the values some calls before; the first value before the first call."""
    earlier: Floats = values[:, np.maximum(np.arange(values.shape[1]) - calls, 0)]
    return earlier


def _delayed(values: Floats, calls: int = 1) -> Floats:
    """Return the values some calls before; 0 before the first call."""
    return np.where(np.arange(values.shape[1]) < calls, 0.0, _before(values, calls))


def _window(values: Floats, calls: int) -> Floats:
    """Return the sums of the last values."""
    return _total(values) - _delayed(_total(values), calls)


def _bounded_total(values: Floats, low: Floats, high: Floats) -> Floats:
    """Return the sums up to each call, each kept within its bounds."""
    sums = np.zeros_like(values)
    total = np.zeros(len(values))
    for k, column in enumerate(values.T):
        total = np.clip(total + column, low.ravel(), high.ravel())
        sums[:, k] = total
    return sums


#: The integral adds each error, or the mean of two; the first one in full, half or not at all.
_AREAS = (
    'total(e) * dt',
    '(total(e) - e[:, :1]) * dt',
    '(total(e) - 0.5 * e) * dt',
    '(total(e) - 0.5 * e - 0.5 * e[:, :1]) * dt',
    '(total(e) - 0.5 * e + 0.5 * e[:, :1]) * dt',
)
PID_LAW = replace(
    read(Path(__file__).with_name('pid.txt')),
    alternatives={
        # The sum is used after, or before the error of this call is added.
        'I': tuple({'area': form} for area in _AREAS for form in (area, f'delayed({area})')),
        'D': ({'change': 'e - before(e)'}, {'change': 'before(measured) - measured'}),
    },
    functions={
        'total': _total,
        'before': _before,
        'delayed': _delayed,
        'window': _window,
        'bounded_total': _bounded_total,
    },
)


def judge_pid(code: HillsCode, settings: Settings, criteria: Collection[str]) -> Iterator[Finding]:
    """Yield a finding for each criterion of `controller.py`."""
    with suppress(UserError):
        code.new_pid(KP, KI, KD)
    gains = code.chosen_gains()
    findings = [*judge_controller(code, settings.seed, criteria)]
    yield from findings
    if gains is None and ignores_gains(code, settings.seed):
        gains = ChosenGains(KP, KI, KD, 'which have no effect')
    conditions = Conditions(
        gains,
        settings.thresholds,
        mended=wrong_terms(findings),
    )
    if 'loop.lab_road' in criteria:
        yield judge_lab_road(code, conditions)
    if 'loop.random_roads' in criteria:
        yield judge_random_roads(code, conditions, settings.seed)


def judge_controller(
    code: HillsCode, seed: int, criteria: Collection[str] = tuple(LABELS)
) -> Iterator[Finding]:
    """Yield a finding for each criterion `pid.…`."""
    reset = judge_reset(code, seed)
    findings = _judge_terms(code, seed)
    if 'pid.windup' in criteria:
        windup, integral = judge_windup(code), findings[1]
        # What follows from a mistake in the integral is not taken off again.
        score = windup.score if integral.passed else max(windup.score, integral.score)
        findings.append(replace(windup, score=score))
    for finding in findings:
        # Randomness comes first in the message: it changes every other result.
        random = not finding.passed and reset.message.startswith(_RANDOM)
        message = f'{reset.message}. So: {finding.message}' if random else finding.message
        yield replace(finding, message=message)
    yield reset


class Term(NamedTuple):
    """A term of the PID, and how it is judged."""

    criterion: str
    name: str  #: P, I or D
    gains: tuple[float, float]
    reach: float  #: amplitude of its output for an error of amplitude 1 and a gain of 1
    max_sum: float = inf  #: [m/s] of the errors

    def only(self, gain: float, kp: float = 0.0) -> Gains:
        """Return gains that are zero except for this term's, and `kp`."""
        own, ki, kd = (gain if name == self.name else 0.0 for name in 'PID')
        return own or kp, ki, kd


TERMS = (
    Term('pid.proportional', 'P', (0.5, 30.0), 1.0),
    # The sum of errors is far below what a limited sum allows.
    Term('pid.integral', 'I', (0.5, 200.0), 0.6, max_sum=1.0),
    Term('pid.derivative', 'D', (0.1, 3.0), 2.0 / TS),
)
_LENGTH = 120  #: calls of a sequence
_TOLERANCE = 1e-9  #: [m/s²]
_RELATIVE = 1e-7
_HALF = 0.5
_KEPT = 0.99  #: A low-pass filter keeps less of its last output.
_KP = (
    'kp multiplies a term that is not its own: the gains are those of '
    'kp * e + ki * (sum of e * dt) + kd * (change of e) / dt'
)


def wandering(seed: int, name: str, amplitude: float, max_sum: float = inf) -> list[Sample]:
    """Return calls with random errors up to ±`amplitude` [m/s], and a reference that changes.

    The errors are smaller where their sum would reach more than `max_sum` [m/s].
    """
    uniform = Random(f'{seed} {name}').uniform  # noqa: S311 (a simulation, not a secret)
    error = amplitude * np.array([uniform(-1.0, 1.0) for _ in range(_LENGTH)])
    error[40:60] = amplitude * uniform(0.5, 1.0)  # a constant error for a while
    steps = [uniform(-0.5, 0.5) for _ in range(4)]
    reference = 8.0 + amplitude * np.repeat(steps, _LENGTH // 4)
    largest_sum = float(np.abs(np.cumsum(error)).max())
    measured = reference - error * min(1.0, max_sum / largest_sum)
    return [(r, v, TS) for r, v in zip(reference.tolist(), measured.tolist(), strict=True)]


def _tried(code: HillsCode, term: Term, seed: int, output: float = 0.1, kp: float = 0.0) -> Trial:
    """Return the outputs of a term alone, or what it adds to P with the gain `kp`.

    There is a row for each of its gains, and a column for each call. Outputs are of the size
    `output` [m/s²]: the usual one is small, as 50 times as much, with a missing dt, is below 8.
    """
    sequences = [
        wandering(
            seed,
            f'{term.criterion} {gain}',
            output / gain / term.reach,
            term.max_sum * output / 0.1,
        )
        for gain in term.gains
    ]
    gains = [term.only(gain, kp) for gain in term.gains]
    reference, measured, dt = np.array(sequences).transpose(2, 0, 1)
    inputs = {'reference': reference, 'measured': measured, 'dt': dt}
    inputs |= dict(zip(('kp', 'ki', 'kd'), np.array(gains).T[..., np.newaxis], strict=True))
    outputs, failure = np.full_like(reference, np.nan), ''
    try:
        outputs = _outputs(code, gains, sequences)
        if kp:
            outputs -= _outputs(code, [term.only(0.0, kp)] * len(gains), sequences)
    except UserError as error:
        failure = str(error)
    inputs |= {'low': outputs.min(1, keepdims=True), 'high': outputs.max(1, keepdims=True)}
    return Trial(term.criterion, term.name, inputs, {term.name: outputs}, failure)


def _outputs(code: HillsCode, gains: Sequence[Gains], sequences: Sequence[list[Sample]]) -> Floats:
    pairs = zip(gains, sequences, strict=True)
    return np.array([code.new_pid(*each).acc_sequence(sequence) for each, sequence in pairs])


def _trial(code: HillsCode, term: Term, seed: int) -> Trial:
    """Return the outputs of a term; where they are 0, those which show why."""
    trial = large = _tried(code, term, seed)
    if not np.any(trial.got[term.name]):
        # Only large outputs are rounded to other numbers than 0; kp can multiply the term.
        large = _tried(code, term, seed, output=100.0)
        other = _tried(code, term, seed, kp=3.0)
        if term.name != 'P' and not other.failure and np.any(other.got[term.name]):
            return other._replace(remark=_KP)
    return trial._replace(remark='' if large.failure else _rounding(large.got[term.name]))


def _factor(got: Floats, form: Floats) -> float:
    """Return the positive factor between outputs, filtered or not; 0 if there is none."""
    got, before, form = got[:, 1:].ravel(), got[:, :-1].ravel(), form[:, 1:].ravel()
    if not _TOLERANCE < np.abs(got).max() < NOT_A_CAR or not np.isfinite(form).all():
        return 0.0
    columns = np.stack([form, before], axis=1)
    filtered = np.linalg.lstsq(columns.T @ columns, columns.T @ got)[0].tolist()
    for scale, kept in ((float(got @ form) / (float(form @ form) or inf), 0.0), filtered):
        rest = got - columns @ (scale, kept)
        if scale > 0.0 <= kept < _KEPT and np.abs(rest).max() <= _RELATIVE * np.abs(got).max():
            factor = scale / (1.0 - kept)  # after a low-pass filter
            return 1.0 if abs(factor - 1.0) <= _RELATIVE else factor
    return 0.0


def _agree(got: Floats, form: Floats) -> bool:
    """Return whether outputs are the same, up to a positive factor."""
    return _factor(got, form) > 0.0 if np.any(got[:, 1:]) else not np.any(form[:, 1:])


@np.errstate(all='ignore')
def _judge_terms(code: HillsCode, seed: int) -> list[Finding]:
    """Return the finding for each term, and that on their factors."""
    if ignored := ignores_gains(code, seed):
        findings = [Finding(term.criterion, *ignored[term.name]) for term in TERMS]
        score = float(np.mean([each.score for each in findings]))
        return [*findings, Finding('pid.dt', score, findings[0].message)]
    trials = {term.name: _trial(code, term, seed) for term in TERMS}
    judge = Judge(PID_LAW, _agree, _call, partial(_line, code), _HALF)
    verdicts = judge.judge([*trials.values()], 'PID')
    findings, remarks, scores = [], [], []
    for term in TERMS:
        score, message, _ = verdicts[term.name]
        scores.append(score)
        if score == 1.0:
            trial = trials[term.name]
            got, forms = trial.got[term.name], PID_LAW.right(trial.inputs, term.name)
            factor = next(filter(None, (_factor(got, form) for form in forms)))
            gains = ' and '.join(f'{gain:g}' for gain in term.gains)
            message = f'right in all {got.size} outputs, for gains of {gains}'
            if factor != 1.0:
                remarks.append(_remark(term.name, factor))
                message += f'; {remarks[-1]}, or choose gains that absorb it'
                scores[-1] = 0.0
        else:
            remarks.append(f'{term.name} is not right')
        findings.append(Finding(term.criterion, score, message))
    # What follows from a mistake in a term is not taken off again.
    right = 'each term has the factor of the formula, dt included'
    return [*findings, Finding('pid.dt', float(np.mean(scores)), '; '.join(remarks) or right)]


def wrong_terms(findings: Sequence[Finding]) -> str:
    """Return the letters of the terms that are there, but wrong."""
    scores = {each.criterion: each.score for each in findings}
    return ''.join(term.name for term in TERMS if 0.0 < scores[term.criterion] < 1.0)


def _call(trial: Trial, index: Index) -> str:
    row, k = index
    error = (trial.inputs['reference'] - trial.inputs['measured'])[row]
    gain = max(float(trial.inputs[name][row, 0]) for name in ('kp', 'ki', 'kd'))
    before = f' after {error[k - 1]:.6g}' if k else ''
    return f'call {k + 1}, with a gain of {gain:g} and e = {error[k]:.6g} m/s{before},'


def _line(code: HillsCode, trial: Trial, name: str, index: Index, wrong: list[float]) -> str:
    row, k = index
    columns = (trial.inputs[key][row, : k + 1].tolist() for key in ('reference', 'measured', 'dt'))
    calls = [*zip(*columns, strict=True)]
    gains = [float(trial.inputs[key][row, 0]) for key in ('kp', 'ki', 'kd')]
    try:
        (*_, output) = code.new_pid(*gains).acc_sequence(calls)
        pid = code.new_pid(*gains)
        pid.acc_sequence(calls[:-1])
    except UserError:
        return ''
    others = [*calls[-1], output - float(trial.got[name][index])]  # P, where that is added
    return code.line_of('steps', (pid.number, calls[-1:]), [*wrong, output], others)


def _rounding(outputs: Floats) -> str:
    """Return a sentence if the outputs are rounded, else an empty string."""
    for digits in range(5):
        if outputs.any() and np.array_equal(outputs, np.round(outputs, digits)):
            return (
                f'the outputs are rounded to {digits} digits: return them as they are'
                if digits
                else 'the outputs are whole numbers: does int(…) or // cut them? Return them as '
                'they are'
            )
    return ''


def _remark(term: str, factor: float) -> str:
    """Return the remark on a term that is right up to a `factor`, which the gains absorb."""
    usual: Mapping[tuple[str, float], str] = {
        ('P', TS): 'P is multiplied by dt: it is kp * e',
        ('I', 1.0 / TS): 'I has no dt: add up ki * e * dt, with dt = 0.02 s',
        ('D', TS): f'D has no dt: divide the change of e by dt = {TS:g} s',
        ('D', TS * TS): f'D is multiplied by dt: divide the change of e by dt = {TS:g} s',
    }
    for (name, value), sentence in usual.items():
        if name == term and abs(factor - value) <= _RELATIVE * value:
            return sentence
    return {
        'P': f'P is multiplied by {factor:g}: it is kp * e',
        'I': f'I uses dt = {factor * TS:g} s: PID is called every {TS:g} s, ki * (sum of e * dt)',
        'D': f'D uses dt = {TS / factor:g} s: PID is called every {TS:g} s, '
        'kd * (e - e_before) / dt',
    }[term]


@np.errstate(all='ignore')
def ignores_gains(code: HillsCode, seed: int) -> dict[str, tuple[float, str]]:
    """Return score and message of each term if outputs are the same for all gains, else nothing.

    A term that is there, with a gain of its own, loses a half.
    """
    rows = wandering(seed, 'gains', 0.01)
    try:
        one, other = (
            code.new_pid(*gains).acc_sequence(rows) for gains in ((1.0, 0.5, 0.1), (3.0, 2.0, 0.7))
        )
    except UserError:
        return {}
    if one != other or not any(one):
        return {}
    error = np.array([[reference - measured for reference, measured, _ in rows]])
    terms = np.concatenate([error, _total(error) * TS, (error - _before(error)) / TS]).T[1:]
    outputs = np.array(one[1:])
    own, *_ = np.linalg.lstsq(terms, outputs)
    fits = np.abs(terms @ own - outputs).max() <= _RELATIVE * min(np.abs(outputs).max(), NOT_A_CAR)
    message = (
        'the gains that PID gets have no effect: it uses numbers of its own. Store kp, ki and kd '
        'in __init__, and use these'
    )
    there = fits & (np.abs(own) > _RELATIVE)
    return {name: (_HALF * bool(each), message) for name, each in zip('PID', there, strict=True)}


_GAINS: Gains = (1.0, 2.0, 0.01)
_AMPLITUDE = 0.3  #: [m/s]
_RANDOM = 'the same speeds give different outputs'


@judges('pid.reset')
def judge_reset(code: HillsCode, seed: int) -> Judged:
    """Return whether each `PID` starts fresh: a second one, one of two, and one after `reset()`.

    The score is the share of these checks that pass; without a `reset()` the last one is left out.
    """
    own, other = (wandering(seed, f'pid.reset {k}', _AMPLITUDE) for k in range(2))
    new = partial(code.new_pid, fresh=False)
    if _differ(*(new(1.0, 0.0, 0.0).acc_sequence(own) for _ in range(2))):
        return 0.0, (
            f"{_RANDOM}: does PID use random numbers, or the computer's clock? It is called every "
            f'{TS:g} s of simulated time'
        )
    used = new(*_GAINS)
    used.acc_sequence(other)
    first = new(*_GAINS).acc_sequence(own)
    if not _differ(first, used.acc_sequence(own)):
        return 0.0, 'PID keeps no errors between calls: I and D need them'
    faults, checks = [], 2
    if shared := _differ(first, new(*_GAINS).acc_sequence(own)):
        faults.append(
            'one run changes the next: is the sum or the last error in a global or class variable, '
            'or does PID use the clock? Set both to 0 in __init__, as self.…'
        )
    one, another = new(*_GAINS), new(*_GAINS)
    in_turn = [
        (one.acc_calculate(*a), another.acc_calculate(*b)) for a, b in zip(own, other, strict=True)
    ]
    if _differ(first, [mine for mine, _ in in_turn]):
        faults.append('two PIDs at the same time share their values: store them in self')
    if used.reset():
        checks += 1
        if not shared and _differ(first, used.acc_sequence(own)):
            faults.append('reset() does not clear the sum or the last error')
    return 1.0 - len(faults) / checks, '; '.join(faults) or 'each run starts fresh'


def _differ(one: list[float], other: list[float]) -> bool:
    return not np.allclose(one, other, rtol=0.0, atol=_TOLERANCE)


_WINDING: Gains = (1.0, 2.0, 0.0)
_PUSHED, _PULLED = 3.0, -0.5  #: [m/s] errors: into the limit, and out of it
_PUSHES, _PULLS = 300, 600  #: calls
_GROWN = 0.5  #: [m/s²] The minimum growth that shows an integral.
_ALLOWED = 25  #: calls until the output leaves the limit


@judges('pid.windup')
def judge_windup(code: HillsCode) -> Judged:
    """Return whether the output leaves its limit when the error changes its sign.

    The car's motor gives ±8 m/s² at most, also if the class has no such limit. Half a second or
    less is full marks; beyond that the score falls with the time.
    """
    calls = [_recovery(code, sign) for sign in (1.0, -1.0)]
    scores = [min(1.0, _ALLOWED / max(n, 1)) if n < _PULLS else 0.0 for n in calls]
    if min(scores) == 1.0:
        return 1.0, 'the output leaves its limit when the error changes its sign'
    longest = max(calls)
    time = f'{longest * TS:.1f} s' if longest < _PULLS else f'more than {_PULLS * TS:g} s'
    return float(np.mean(scores)), (
        f'the integral winds up: after {_PUSHES * TS:g} s with the output at its limit of '
        f'{ACCELERATION_LIMIT:g} m/s² the error changed its sign, and the output stayed there for '
        f'{time}. Do not add to the integral while the output is at its limit'
    )


def _recovery(code: HillsCode, sign: float) -> int:
    """Return the number of calls until the output leaves its limit."""
    pid = code.new_pid(*_WINDING, limit=ACCELERATION_LIMIT)
    pushed, pulled = (
        sign * np.array(pid.acc_sequence([(8.0, 8.0 - sign * error, TS)] * count))
        for error, count in ((_PUSHED, _PUSHES), (_PULLED, _PULLS))
    )
    if (maximum := pushed.max()) <= _WINDING[0] * _PUSHED + _GROWN:
        raise UserError(
            f'with an error of {_PUSHED:g} m/s for {_PUSHES * TS:g} s the output is at most '
            f'{maximum + 0.0:.3g} m/s²: is each error added to the sum, and is no limit too small?'
        )
    largest = float(np.abs([*pushed, *pulled]).max())
    if not largest < NOT_A_CAR:
        raise UserError(
            f'the output reaches {largest:.3g} m/s² while the error is {_PUSHED:g} m/s at most'
        )
    inside = np.flatnonzero(pulled < min(float(maximum), ACCELERATION_LIMIT) - _TOLERANCE)
    return int(inside[0]) if inside.size else _PULLS
