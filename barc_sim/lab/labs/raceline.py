"""Lab 4 as data: the speed of a lap, a racing line, and the program of an MPC.

A function with one right answer is judged by its numbers: a mistake is a wrong program that returns
the same. A line is judged by what it measures, and by laps. The time of a lap is not judged.
"""

from __future__ import annotations

from contextlib import suppress
from functools import cache, cached_property, partial
from math import inf
from pathlib import Path
from random import Random
from typing import TYPE_CHECKING, Any

import numpy as np

from barc_sim.control.lane import STEERING_LIMIT, LaneLaw, LaneLQR, speed_profile, steady_turn
from barc_sim.control.planning import lap_time, racing_line, solver
from barc_sim.errors import UserError
from barc_sim.lab import files
from barc_sim.lab.confined.process import JudgedCode
from barc_sim.lab.judge import Evidence, Finding, Lab, Part, Table, judged, share
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

    from barc_sim.lab.judge import Floats, Settings
    from barc_sim.simulation.log import TrackLog

LABELS = {
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
LIMITS = 12.0, 3.5, 2.0  #: [m/s], and [m/s²] across and along
_STEPS = 10  #: of a plan
_SIZES = {'profile': POINTS, 'line': POINTS, 'predict': 6, 'program': _STEPS * (_STEPS + 1)}
_L = L_F + L_R
_NAMED = 0.4  #: of the points are left for a mistake that is known
_BENT = 1.1  #: times the bending of the best line: full marks
_LOAD = (1.1, 1.5)  #: times the acceleration across: full marks, none
_TOLERANCE = 1e-6
_NO_COST = 1e12  #: that a number of a program is below


def profile(
    curvatures: Sequence[float],
    step: float,
    *,
    top: float = LIMITS[0],
    across: float = LIMITS[1],
    root: float = 0.5,
    right: bool = True,
    passes: Sequence[int] = (1, -1),
    gain: float = 2.0 * LIMITS[2],
    power: float = 2.0,
    closed: bool = True,
) -> list[float]:
    """Return the fastest speeds of a lap: a pass to accelerate, one to brake."""
    bends = np.abs(curvatures) if right else np.maximum(curvatures, 0.0)
    found = np.minimum(top, (across / np.maximum(bends, 1e-9)) ** root) ** power
    n = len(found)
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
    model: Sequence[float] | None = None,
) -> list[float]:
    """Return the Hessian, row by row, and the gradient of the cost of ten commands."""
    *matrix, b1, b2 = predict(speed) if model is None else model
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
    if name == 'predict':
        return [[uniform(2.0, 12.0)] for _ in range(10)]
    if name == 'program':
        return [[uniform(-2.0, 2.0), uniform(-0.5, 0.5), uniform(3.0, 9.0)] for _ in range(6)]
    track = Track.named('L')
    step = track.length / POINTS
    places = np.array([[uniform(0.0, track.length)] for _ in range(3)]) + step * np.arange(POINTS)
    return [[[float(track.curvature(s)) for s in lap], step] for lap in places.tolist()]


PROGRAMS: dict[str, Callable[..., list[float]]] = {
    each.__name__: each for each in (profile, predict, program)
}


def _mistakes() -> dict[str, list[tuple[str, Callable[..., list[float]]]]]:
    """Return the wrong programs of each function with their sentences, from `raceline.txt`."""
    text = Path(__file__).with_suffix('.txt').read_text(encoding='utf-8')
    found: dict[str, list[tuple[str, Callable[..., list[float]]]]] = {}
    for section in text.split('\n# ')[1:]:
        name, *lines = section.strip().splitlines()
        rows = (line.partition(': ') for line in lines)
        found[name] = [
            (sentence, partial(PROGRAMS[name], **eval(f'dict({options})', {'inf': inf})))  # noqa: S307 (ours)
            for options, _, sentence in rows
        ]
    return found


MISTAKES = _mistakes()


class RacelineCode(JudgedCode):
    """A user's `raceline.py`."""

    def numbers(self, name: str, rows: Sequence[Sequence[Any]]) -> Floats:
        """Return what a function returns for each row of arguments."""
        return np.array(self.rows(name, rows, _SIZES[name]))


def _near(got: Floats, right: Any) -> bool:  # noqa: ANN401 (rows of numbers)
    return bool(np.allclose(got, right, rtol=_TOLERANCE, atol=_TOLERANCE))


def _judge_function(code: RacelineCode, name: str, seed: int) -> tuple[float, str]:
    """Return score and message of a function: right, a known mistake, or its largest error."""
    rows = _rows(name, seed)
    right, got = np.array([PROGRAMS[name](*row) for row in rows]), code.numbers(name, rows)
    if _near(got, right):
        return 1.0, f'right in all {len(rows)} cases'
    if name == 'program':
        with suppress(UserError):
            models = [code.numbers('predict', [row[2:]])[0] for row in rows]
            if _near(got, [program(*r, model=m) for r, m in zip(rows, models, strict=True)]):
                return 1.0, 'right, with the model of predict'
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


#: The best line of a track.
_best = cache(racing_line)


class _Line:
    """A student's line of a track, its offsets cut to their bounds."""

    def __init__(self, code: RacelineCode, track: Track) -> None:
        arguments, self._through = line_through(track)
        offsets, half = code.numbers('line', [arguments])[0], arguments[-1]
        self.beyond = float(np.abs(offsets).max()) - half
        self._offsets = np.clip(offsets, -half, half)
        self.track = track

    @cached_property
    def line(self) -> Track:
        """The track along it; a UserError where no car can follow it."""
        return self._through(self._offsets.tolist())

    def bending(self) -> tuple[float, str]:
        """Return score and message of how much it bends."""
        best, centre, own = map(_bending, (_best(self.track), self.track, self.line))
        score = share(own, _BENT * best, centre)
        text = f'{own:.3g} 1/m is the integral of its squared curvature; that of the centre line '
        text += f'{centre:.3g}, of the best line {best:.3g}'
        if score < 1.0:
            k = int(np.abs(self.line.curvatures).argmax())
            radius, point = 1.0 / abs(self.line.curvatures[k]), k // 2 + 1
            text += f'; it bends most at point {point} of {POINTS}, with a radius of {radius:.1f} m'
        with suppress(UserError):  # no car can follow the mirror image of some
            turned = _bending(self._through((-self._offsets).tolist()))
            if share(turned, _BENT * best, centre) > score + 0.3:
                text = f'the other way round it bends less: positive is to the left. {text}'
        return score, text

    def drive(self) -> tuple[float, str, TrackLog]:
        """Return score and message of laps at the speed that the line allows, and their log."""
        speed = speed_profile(self.line, *LIMITS)
        log = lap(LaneLQR(), self.line, speed=speed, laps=2, dynamics='dynamic')
        beside = np.asarray(self.track.frenet(log.x, log.y, log.psi).e_y)
        across = float(np.abs(log.v_x * log.psi_dot).max())
        whole = log.s[-1] >= 2.0 * self.line.length
        if not whole or np.abs(beside).max() > 0.5 * self.track.width:
            return 0.0, f'the car leaves the track, {log.s[-1]:.0f} m along the line', log
        text = f'best lap {log.best:.2f} s (not judged; planned {lap_time(self.line, speed):.2f} s)'
        text += f', at most {across:.2f} m/s² across ({_LOAD[0] * LIMITS[1]:.2f} is full marks)'
        return share(across / LIMITS[1], *_LOAD), text, log


def _judge_line(code: RacelineCode, seed: int) -> Iterator[Finding]:
    """Yield a finding for each criterion of the line."""
    left = ['line.inside', 'line.bending', 'line.lap', 'line.hidden']
    try:
        own, text = _Line(code, Track.named('L')), 'it keeps its bounds'
        if outside := own.beyond > _TOLERANCE:
            text = f'it leaves its bounds by {own.beyond:.3g} m; the rest is judged within these'
        yield Finding(left.pop(0), float(not outside), text)
        bent, text = own.bending()
        yield Finding(left.pop(0), bent, text)
        score, text, log = own.drive()
        shown = Evidence(_table(own, log), partial(_figure, own.line))
        yield Finding(left.pop(0), score, text, shown)
        hidden = _Line(code, hidden_track(seed))
        (bent, text), (driven, lap_text, _) = hidden.bending(), hidden.drive()
        yield Finding(left.pop(0), min(bent, driven), f'{text}; {lap_text}')
    except UserError as error:
        yield from (Finding(name, 0.0, str(error)) for name in left)


def _table(own: _Line, log: TrackLog) -> Table:
    """Return the planned laps of three lines, and the one that was driven."""
    rows = []
    for name, line in (('centre', own.track), ('yours', own.line), ('best', _best(own.track))):
        planned = lap_time(line, speed_profile(line, *LIMITS))
        driven = f'{log.best:.2f} s' if name == 'yours' and log.best < inf else ''
        cells = f'{line.length:.1f} m', f'{_bending(line):.3g} 1/m', f'{planned:.2f} s', driven
        rows.append((name, *cells))
    return Table('L, line by line', ('line', 'length', 'bending', 'planned lap', 'driven'), rows)


def _figure(line: Track, title: str = '') -> Figure:
    """Draw the line between the edges, and its speed."""
    from barc_sim.figures.track_figure import line_figure  # noqa: PLC0415 (slow)

    track = Track.named('L')
    figure = line_figure(track, line, *(speed_profile(each, *LIMITS) for each in (track, line)))
    figure.suptitle(title)
    return figure


class _Planned(LaneLaw):
    """Steers by the first command of a user's program, solved within the limits."""

    def __init__(self, code: RacelineCode) -> None:
        super().__init__()
        self._code, self._solve = code, solver()

    def steer_calculate(
        self, e_y: float, e_psi: float, speed: float, curvature: Callable[[float], float]
    ) -> float:
        """Return the steering angle [rad]."""
        steer, heading = steady_turn(curvature(0.0))
        numbers = self._code.numbers('program', [[e_y, e_psi - heading, max(speed, 1.0)]])[0]
        if np.abs(numbers).max() > _NO_COST:
            raise UserError(f'program: H and g must be within {_NO_COST:g}')
        hessian, gradient = numbers[:-_STEPS].reshape(_STEPS, _STEPS), numbers[-_STEPS:].copy()
        free, none = np.full(_STEPS, STEERING_LIMIT), np.empty((0, _STEPS))
        commands, _, flag, _ = self._solve(
            0.5 * (hessian + hessian.T), gradient, none, free - steer, -free - steer
        )
        if flag < 1:
            raise UserError('program: no command is the best; H must be positive definite')
        return steer + float(commands[0])


def _judge_lap(code: RacelineCode, settings: Settings) -> tuple[float, str]:
    """Return score and message of a lap that the user's program steers."""
    track, by = Track.named('L'), settings.thresholds
    log = drive_law(lambda _: _Planned(code), track, track.length)
    text = f'{describe(log)} ({by.full_rms:g} and {by.full_max:g} m are full marks)'
    return by.score(*drive_errors(log)), text


def _judge(code: RacelineCode, settings: Settings, criteria: Collection[str]) -> Iterator[Finding]:
    """Yield a finding for each criterion; UserError where daqp is not installed."""
    solver()
    yield judged('speed.profile', _judge_function, code, 'profile', settings.seed)
    if any(name.startswith('line.') for name in criteria):
        yield from _judge_line(code, settings.seed)
    model = judged('mpc.model', _judge_function, code, 'predict', settings.seed)
    plan = judged('mpc.program', _judge_function, code, 'program', settings.seed)
    yield from (model, plan)
    if 'mpc.lap' in criteria:
        found = judged('mpc.lap', _judge_lap, code, settings)
        # What follows from a known mistake is not taken off again: a right program keeps the lane.
        if found.score < 1.0 and _NAMED in {model.score, plan.score}:
            text = f'full marks, with what is wrong in the program put right; now: {found.message}'
            found = Finding('mpc.lap', 1.0, text)
        yield found
    yield Finding('line.gain', 0.0, f'the figure, and two sentences: {BY_EYE}', open=True)


RACELINE = Lab(
    files.RACELINE,
    RacelineCode,
    {'raceline': Part(LABELS, _judge)},
    by_eye=frozenset({'line.gain'}),
)
