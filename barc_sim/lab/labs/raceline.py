"""Lab 4 as data: the speed of a lap, a racing line, and the program of an MPC.

A function with one right answer is judged by its numbers: a mistake is a wrong program that returns
the same. A line is judged by what it measures, and by laps. The time of a lap is not judged.
"""

from __future__ import annotations

from contextlib import suppress
from functools import cache, partial
from math import inf
from pathlib import Path
from random import Random
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from barc_sim.control.lane import STEERING_LIMIT, LaneLaw, LaneLQR, speed_profile, steady_turn
from barc_sim.control.planning import lap_time, racing_line, solver
from barc_sim.errors import UserError
from barc_sim.lab import files
from barc_sim.lab.judge import (
    Evidence,
    Finding,
    JudgedCode,
    Lab,
    Part,
    Table,
    numbers_of,
    share,
)
from barc_sim.lab.labs.lane import describe, drive_errors, drive_law, hidden_track
from barc_sim.lab.user_code.adapters import line_through
from barc_sim.lab.user_code.code import POINTS
from barc_sim.lab.user_code.folder import BY_EYE
from barc_sim.simulation.closed_loop import lap
from barc_sim.vehicle.bike_model import L_F, L_R
from barc_sim.vehicle.track import Track

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterator, Sequence

    from matplotlib.figure import Figure

    from barc_sim.lab.judge import Settings
    from barc_sim.lab.laws import Floats
    from barc_sim.simulation.log import TrackLog

LABELS = {
    'speed.corner': 'Speed: in a turn',
    'speed.profile': 'Speed: of a lap',
    'line.inside': 'Line: between the edges',
    'line.bending': 'Line: how much it bends',
    'line.lap': 'Line: laps of L',
    'line.hidden': 'Line: a hidden track',
    'mpc.model': 'MPC: the model',
    'mpc.program': 'MPC: the quadratic program',
    'mpc.lap': 'MPC: a lap of L',
    'line.gain': 'Line: what it gains, and why',
}
TOP, ACROSS, ALONG = 12.0, 3.5, 2.0  #: [m/s], [m/s²] and [m/s²]
_STEPS = 10  #: of a plan
_SIZES = {
    'corner': 1,
    'profile': POINTS,
    'predict': 6,
    'program': _STEPS * (_STEPS + 1),
    'line': POINTS,
}
_L = L_F + L_R
_NAMED = 0.4  #: of the points are left for a mistake that is known
_BENT = 1.1  #: times the bending of the best line: full marks
_LOAD = (1.1, 1.5)  #: times the acceleration across: full marks, none
_TOLERANCE = 1e-6
_NO_COST = 1e12  #: that a number of a program is below


def corner(
    curvature: float,
    top: float = TOP,
    across: float = ACROSS,
    power: float = 0.5,
    *,
    right: bool = True,
) -> list[float]:
    """Return the maximum speed in a turn."""
    is_free = not curvature or (curvature < 0.0 and not right)
    return [TOP if is_free else min(top, (across / abs(curvature)) ** power)]


def profile(
    limits: Sequence[float],
    step: float,
    *,
    passes: Sequence[int] = (1, -1),
    gain: float = 2.0 * ALONG,
    power: float = 2.0,
    closed: bool = True,
) -> list[float]:
    """Return the fastest speeds of a lap within its limits: a pass to accelerate, one to brake."""
    found, n = np.array(limits) ** power, len(limits)
    for way in passes:
        for k in range(2 * n if closed else n - 1):
            i, j = (k % n, (k + 1) % n) if way > 0 else (-k % n - 1, -(k + 1) % n - 1)
            found[j] = min(found[j], found[i] + gain * step)
    return [*(found ** (1.0 / power)).tolist()]


def predict(
    speed: float,
    dt: float = 0.1,
    offset: float = L_R,
    half: float = 0.5,
    sign: float = 1.0,
    order: Sequence[int] = range(6),
) -> list[float]:
    """Return the model [a11, a12, a21, a22, b1, b2] of a step at a constant speed."""
    d = speed * dt
    numbers = 1.0, d, 0.0, 1.0, sign * d * (offset + half * d) / _L, sign * d / _L
    return [numbers[k] for k in order]


def program(
    e_y: float,
    e_psi: float,
    speed: float,
    *,
    weights: Sequence[float] = (1.0, 1.0, 5.0),  # of e_y, e_psi and the steering
    first: int = 1,
    scale: Sequence[float] = (2.0, 2.0),
    model: Callable[[float], Sequence[float]] = predict,
) -> list[float]:
    """Return the Hessian, row by row, and the gradient of the cost of ten commands."""
    *matrix, b1, b2 = model(speed)
    a, now, by = np.reshape(matrix, (2, 2)), np.array([e_y, e_psi]), np.zeros((2, _STEPS))
    hessian, gradient = weights[2] * np.eye(_STEPS), np.zeros(_STEPS)
    for k in range(_STEPS + 1):
        if first <= k < _STEPS + first:
            weighted = by.T * weights[:2]
            hessian += weighted @ by
            gradient += weighted @ now
        now, by = a @ now, a @ by
        if k < _STEPS:
            by[:, k] += b1, b2
    return [*(scale[0] * hessian).ravel().tolist(), *(scale[1] * gradient).tolist()]


def _rows(name: str, seed: int) -> list[list[Any]]:
    """Return the arguments of the calls of a function."""
    uniform = Random(f'{seed} {name}').uniform  # noqa: S311 (a simulation, not a secret)
    if name == 'corner':
        return [[0.0], *([uniform(-0.2, 0.2)] for _ in range(40))]
    if name == 'predict':
        return [[uniform(2.0, 12.0)] for _ in range(10)]
    if name == 'program':
        return [[uniform(-2.0, 2.0), uniform(-0.5, 0.5), uniform(3.0, 9.0)] for _ in range(6)]
    track = Track.named('L')
    step = track.length / POINTS
    starts = [uniform(0.0, track.length) for _ in range(3)]
    places = [[start + k * step for k in range(POINTS)] for start in starts]
    return [[[*map(_allowed, own)], step] for own in places]


def _allowed(s: float) -> float:
    return corner(float(Track.named('L').curvature(s)))[0]


class Mistake(NamedTuple):
    """A wrong program, and the sentence that its author gets."""

    sentence: str
    program: Callable[..., list[float]]


def _mistakes() -> dict[str, list[Mistake]]:
    """Return the mistakes in each function, as `raceline.txt` has them."""
    text = Path(__file__).with_suffix('.txt').read_text(encoding='utf-8')
    found: dict[str, list[Mistake]] = {}
    for section in text.split('\n# ')[1:]:
        name, *lines = section.strip().splitlines()
        for line in lines:
            options, _, sentence = line.partition(': ')
            wrong = partial(RIGHT_PROGRAMS[name], **eval(f'dict({options})', {'inf': inf}))  # noqa: S307 (ours)
            found.setdefault(name, []).append(Mistake(sentence, wrong))
    return found


RIGHT_PROGRAMS: dict[str, Callable[..., list[float]]] = {
    each.__name__: each for each in (corner, profile, predict, program)
}
MISTAKES = _mistakes()


class RacelineCode(JudgedCode):
    """A user's `raceline.py`."""

    def numbers(self, name: str, rows: Sequence[Sequence[Any]]) -> Floats:
        """Return what a function returns for each row of arguments."""
        if (size := _SIZES[name]) > 1:
            return np.array(self.rows(name, rows, size))
        found = self.call('functions', name, rows)
        return np.array(numbers_of(name, found, len(rows)))[:, np.newaxis]


def _near(got: Floats, right: Any) -> bool:  # noqa: ANN401 (rows of numbers)
    return bool(np.allclose(got, right, rtol=_TOLERANCE, atol=_TOLERANCE))


@np.errstate(all='ignore')  # of numbers of any size
def _judged(code: RacelineCode, name: str, seed: int) -> tuple[float, str]:
    """Return score and message of a function: right, a known mistake, or its largest error."""
    rows = _rows(name, seed)
    right = np.array([RIGHT_PROGRAMS[name](*row) for row in rows])
    try:
        got = code.numbers(name, rows)
        if _near(got, right):
            return 1.0, f'right in all {len(rows)} cases'
        if name == 'program':

            def own(speed: float) -> list[float]:
                return [float(each) for each in code.numbers('predict', [[speed]])[0]]

            if _near(got, [program(*row, model=own) for row in rows]):
                return 1.0, 'right, with the model of predict'
    except UserError as error:
        return 0.0, str(error)
    i, k = map(int, np.unravel_index(np.abs(got - right).argmax(), right.shape))
    line = code.line_of('functions', (name, [rows[i]]), [float(got[i, k])], [])
    place = f'{line}: ' if line else ''
    for sentence, wrong in MISTAKES[name]:
        if _near(got, [wrong(*row) for row in rows]):
            return _NAMED, place + sentence
    shown = ', '.join(f'{each:.4g}' for each in rows[i] if isinstance(each, float))
    text = f'{place}{name}({shown}) gave {got[i, k]:.6g} as number {k + 1}, expected '
    return 0.0, f'{text}{right[i, k]:.6g}'


def _bending(track: Track) -> float:
    """Return the integral of the square of the curvature over a lap [1/m]."""
    return sum(k * k * length for k, length in zip(track.curvatures, track.lengths, strict=True))


@cache
def _best(track: Track) -> Track:
    return racing_line(track)


class _Line(NamedTuple):
    """A student's line of a track."""

    track: Track
    line: Track
    turned: Track | None  #: the line with offsets to the other side, where a car can follow it

    @property
    def bending(self) -> tuple[float, str]:
        """Score and message of how much it bends."""
        best, centre, own = map(_bending, (_best(self.track), self.track, self.line))
        score = share(own, _BENT * best, centre)
        text = f'{own:.3g} 1/m is the integral of its squared curvature; that of the centre line '
        text += f'{centre:.3g}, of the best line {best:.3g}'
        if score < 1.0:
            k = int(np.abs(self.line.curvatures).argmax())
            radius, point = 1.0 / abs(self.line.curvatures[k]), k // 2 + 1
            text += f'; it bends most at point {point} of {POINTS}, with a radius of {radius:.1f} m'
        turned = share(_bending(self.turned), _BENT * best, centre) if self.turned else 0.0
        if score < 0.5 and turned > score + 0.3:  # noqa: PLR2004
            text = f'the other way round it bends less: positive is to the left. {text}'
        return score, text

    def drive(self) -> tuple[float, str, TrackLog]:
        """Return score and message of laps at the speed that the line allows, and their log."""
        speed = speed_profile(self.line, TOP, ACROSS, ALONG)
        log = lap(LaneLQR(), self.line, speed=speed, laps=2, dynamics='dynamic')
        beside = np.asarray(self.track.frenet(log.x, log.y, log.psi).e_y)
        load = float(np.abs(log.v_x * log.psi_dot).max()) / ACROSS
        times, whole = log.lap_times, log.s[-1] >= 2.0 * self.line.length
        if not whole or np.abs(beside).max() > 0.5 * self.track.width:
            return 0.0, f'the car leaves the track, {log.s[-1]:.0f} m along the line', log
        text = f'best lap {min(times):.2f} s (not judged; planned '
        text += f'{lap_time(self.line, speed):.2f} s), at most {load * ACROSS:.2f} m/s² across'
        return share(load, *_LOAD), f'{text} ({_LOAD[0] * ACROSS:.2f} is full marks)', log


def _offsets(code: RacelineCode, track: Track) -> tuple[Floats, float]:
    """Return a student's offsets, and their bound."""
    arguments, _ = line_through(track)
    return code.numbers('line', [arguments])[0], arguments[-1]


def _line_of(track: Track, offsets: Floats, half: float) -> _Line:
    """Return a student's line, its offsets clipped to their bounds."""
    _, through = line_through(track)
    inside = np.clip(offsets, -half, half)
    line, turned = through(inside.tolist()), None
    with suppress(UserError):
        turned = through((-inside).tolist())
    return _Line(track, line, turned)


def _judge_line(code: RacelineCode, seed: int) -> Iterator[Finding]:
    """Yield a finding for each criterion of the line."""
    left = ['line.inside', 'line.bending', 'line.lap', 'line.hidden']
    try:
        track = Track.named('L')
        offsets, half = _offsets(code, track)
        beyond, text = float(np.abs(offsets).max()) - half, 'it keeps its bounds'
        if beyond > _TOLERANCE:
            text = f'it leaves its bounds by {beyond:.3g} m; the rest is judged within these'
        yield Finding(left.pop(0), float(beyond <= _TOLERANCE), text)
        own = _line_of(track, offsets, half)
        yield Finding(left.pop(0), *own.bending)
        score, text, log = own.drive()
        shown = Evidence(_table(own, log), partial(_figure, own.line))
        yield Finding(left.pop(0), score, text, shown)
        track = hidden_track(seed)
        hidden = _line_of(track, *_offsets(code, track))
        (bent, text), (driven, lap_text, _) = hidden.bending, hidden.drive()
        yield Finding(left.pop(0), min(bent, driven), f'{text}; {lap_text}')
    except UserError as error:
        yield from (Finding(name, 0.0, str(error)) for name in left)


def _table(own: _Line, log: TrackLog) -> Table:
    """Return the planned laps of three lines, and the one that was driven."""
    rows = []
    for name, line in (('centre', own.track), ('yours', own.line), ('best', _best(own.track))):
        planned = lap_time(line, speed_profile(line, TOP, ACROSS, ALONG))
        driven = f'{min(log.lap_times):.2f} s' if name == 'yours' and len(log.lap_times) else ''
        cells = f'{line.length:.1f} m', f'{_bending(line):.3g} 1/m', f'{planned:.2f} s', driven
        rows.append((name, *cells))
    return Table('L, line by line', ('line', 'length', 'bending', 'planned lap', 'driven'), rows)


def _figure(line: Track, title: str = '') -> Figure:
    """Draw the line between the edges, and its speed."""
    from barc_sim.figures.track_figure import line_figure  # noqa: PLC0415 (slow)

    track = Track.named('L')
    speeds = (speed_profile(each, TOP, ACROSS, ALONG) for each in (track, line))
    figure = line_figure(track, line, *speeds)
    figure.suptitle(title)
    return figure


class _Planned(LaneLaw):
    """Steers by the first command of a user's program, solved within the limits."""

    def __init__(self, code: RacelineCode) -> None:
        super().__init__()
        self._code, self._solve = code, solver().solve

    def steer_calculate(
        self, e_y: float, e_psi: float, speed: float, curvature: Callable[[float], float]
    ) -> float:
        """Return the steering angle [rad]."""
        steer, heading = steady_turn(curvature(0.0))
        row = [e_y, e_psi - heading, max(speed, 1.0)]
        numbers = self._code.numbers('program', [row])[0]
        if np.abs(numbers).max() > _NO_COST:
            raise UserError(f'program: H and g must be within {_NO_COST:g}')
        hessian, gradient = numbers[:-_STEPS].reshape(_STEPS, _STEPS), numbers[-_STEPS:]
        hessian = 0.5 * (hessian + hessian.T)
        free, none = np.full(_STEPS, STEERING_LIMIT), np.empty((0, _STEPS))
        commands, _, flag, _ = self._solve(
            hessian, gradient.copy(), none, free - steer, -free - steer
        )
        if flag < 1:
            raise UserError('program: no command is the best; H must be positive definite')
        return steer + float(commands[0])


def _judge_mpc(code: RacelineCode, settings: Settings, *, mended: bool) -> Finding:
    """Return the finding on a lap that the user's program steers.

    What follows from a known mistake in it is not taken off again: a right program keeps the lane.
    """
    by = settings.thresholds
    try:
        track = Track.named('L')
        log = drive_law(lambda _: _Planned(code), track, track.length)
        score, text = by.score(*drive_errors(log)), describe(log)
        text += f' ({by.full_rms:g} and {by.full_max:g} m are full marks)'
    except UserError as error:
        score, text = 0.0, str(error)
    if mended and score < 1.0:
        score, text = 1.0, f'full marks, with what is wrong in the program put right; now: {text}'
    return Finding('mpc.lap', score, text)


def _judge(code: RacelineCode, settings: Settings, criteria: Collection[str]) -> Iterator[Finding]:
    """Yield a finding for each criterion; UserError where daqp is not installed."""
    solver()
    found = {name: _judged(code, name, settings.seed) for name in RIGHT_PROGRAMS}
    yield Finding('speed.corner', *found['corner'])
    yield Finding('speed.profile', *found['profile'])
    if any(name.startswith('line.') for name in criteria):
        yield from _judge_line(code, settings.seed)
    yield Finding('mpc.model', *found['predict'])
    yield Finding('mpc.program', *found['program'])
    if 'mpc.lap' in criteria:
        mended = any(0.0 < found[name][0] < 1.0 for name in ('predict', 'program'))
        yield _judge_mpc(code, settings, mended=mended)
    yield Finding('line.gain', 0.0, f'the figure, and two sentences: {BY_EYE}', open=True)


RACELINE = Lab(
    files.RACELINE,
    RacelineCode,
    {'raceline': Part(LABELS, _judge)},
    by_eye=frozenset({'line.gain'}),
)
