"""Lab 3, lane keeping: the errors beside a track, the steady turn, and a class `Lane` that drives.

A mistake is named where it was tried: the same drive with one change to what the law gets or
returns, and what that gave.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache, partial
from itertools import count
from math import inf, pi
from pathlib import Path
from random import Random
from typing import TYPE_CHECKING, Any, NamedTuple, cast

import numpy as np

from barc_sim.control.lane import STEERING_LIMIT, LaneLaw, steady_turn
from barc_sim.errors import UserError
from barc_sim.lab import handout
from barc_sim.lab.judge import Finding, Functions, JudgedCode, Lab, Part, Table, numbers_of
from barc_sim.lab.laws import read
from barc_sim.lab.user_code.folder import BY_EYE
from barc_sim.simulation.closed_loop import closed_loop, lap, plant_of
from barc_sim.simulation.log import TrackLog
from barc_sim.simulation.metrics import track_laps_of
from barc_sim.vehicle.bike_model import L_F, L_R, State
from barc_sim.vehicle.track import Track, l_shape

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterator, Mapping, Sequence

    from matplotlib.figure import Figure

    from barc_sim.lab.judge import Settings, Thresholds
    from barc_sim.lab.laws import Floats
    from barc_sim.vehicle.plant import Plant


LABELS = {
    'errors.straight_e_y': 'Errors: e_y beside a straight',
    'errors.straight_e_psi': 'Errors: e_psi beside a straight',
    'errors.arc_e_y': 'Errors: e_y beside an arc',
    'errors.arc_e_psi': 'Errors: e_psi beside an arc',
    'steady.delta': 'Steady turn: steering',
    'steady.e_psi': 'Steady turn: e_psi',
}


def _wrapped(angle: Floats) -> Floats:
    return np.arctan2(np.sin(angle), np.cos(angle))


_FORMULAS: Mapping[str, Callable[..., Floats]] = {
    'wrapped': _wrapped,
    'hypot': np.hypot,
    'sqrt': np.sqrt,
    'arcsin': np.arcsin,
}
LAW = replace(read(Path(__file__).with_name('lane.txt'), L_F=L_F, L_R=L_R), functions=_FORMULAS)
_RESULTS = {
    'straight_errors': ('straight_e_y', 'straight_e_psi'),
    'arc_errors': ('arc_e_y', 'arc_e_psi'),
    'steady': ('steady_delta', 'steady_e_psi'),
}
FUNCTIONS = Functions(
    LAW,
    {
        'straight_errors': 'x y psi x_0 y_0 psi_0',
        'arc_errors': 'x y psi x_c y_c radius',
        'steady': 'curvature',
    },
    _RESULTS,
    dict(zip((name for own in _RESULTS.values() for name in own), LABELS, strict=True)),
)


DRIVE_LABELS = {
    'lane.signs': 'Lane: signs and symmetry',
    'lane.return': 'Lane: back from 1 m beside the line',
    'lane.laps': 'Lane: three laps of L',
    'lane.hidden': 'Lane: a hidden track',
    'lane.delay': 'Lane: what a delay does',
}
SPEED = 6.0  #: [m/s]
_LAPS, _MAX_DURATION = 3, 200.0
_STRAIGHT = Track((1e4,), (0.0,), name='a straight')
_OFF, _BACK = 1.0, 0.1  #: [m] beside the line, at the start and when it counts as back
_SEEN = 80.0  #: [m] of the way back
# Full marks up to the first, none from the second on:
_DISTANCE = (30.0, 60.0)  #: [m] until it is back
_OVERSHOOT = (0.2, 0.6)  #: share of the start
_SATURATED = (0.1, 0.5)  #: share of the steps up to the first distance
_CIRCLE = 20.0  #: [m] radius
_PROBED = 0.1  #: [m] and [rad] errors
_NEGLIGIBLE = 1e-6  #: [rad]
_TWO = 2  #: wrong signs: no points
_ONE_WRONG = 0.2  #: of the points are left
_DEGREES = (45.0, 70.0)  #: times the right angle, of an output in degrees
_BETTER = 0.1  #: of a score: what is tried is named where it gives as much more


class LaneCode(JudgedCode):
    """A user's `lane.py`."""

    _lanes = count()

    def called(self, do: str, *arguments: Any) -> str:  # noqa: ANN401 (JSON)
        """Return the user's name for what a request calls."""
        return {'functions': str(arguments[0]) if arguments else '', 'notes': do}.get(do, 'Lane')

    def new_lane(self, track: Track, sign: float = 1.0) -> int:
        """Return the number of a new `Lane` on a track; its file is loaded again.

        It reads the curvature times `sign`.
        """
        number = next(self._lanes)
        self.call('new_lane', number, track.starts[1:], [sign * each for each in track.curvatures])
        return number

    def steer(self, number: int, row: Sequence[float]) -> float:
        """Return the steering angle [rad] of a `Lane` for e_y, e_psi, speed and place."""
        return numbers_of('Lane', self.call('steer', number, [row]), 1)[0]


_Three = tuple[float, float, float]


class Change(NamedTuple):
    """What is tried with a law: other inputs, or another output."""

    sentence: str = ''  #: what is wrong, or the criterion that names it
    inputs: _Three = (1.0, 1.0, 1.0)  #: factors of e_y, e_psi and the curvature
    factor: float = 1.0  #: of the output
    ahead: float = 0.0  #: [m] from where the curvature is read
    steady: float = 0.0  #: times e_psi of the steady turn are taken off e_psi
    added: _Three = (0.0, 0.0, 0.0)  #: gains of the output for the same three
    fits: str = ''  #: what a probe of the law must have found

    def on(self, other: Change) -> Change:
        """Return both changes at once, with this one's sentence."""
        return self._replace(
            inputs=_each(float.__mul__, self.inputs, other.inputs),
            factor=self.factor * other.factor,
            ahead=self.ahead + other.ahead,
            steady=self.steady + other.steady,
            added=_each(float.__add__, self.added, other.added),
        )


def _each(operation: Callable[[float, float], float], one: _Three, other: _Three) -> _Three:
    a, b, c = map(operation, one, other)
    return a, b, c


_TRIED = (
    Change(
        'the curvature has no effect: add the steering of steady(curvature(0.0)), and take its '
        'e_psi off e_psi',
        steady=1.0,
        added=(0.0, 0.0, 1.0),
        fits='no curvature',
    ),
    Change('e_psi has no effect: add -0.6 * e_psi', added=(0.0, -0.6, 0.0), fits='no e_psi'),
    Change('e_y has no effect: add -0.2 * e_y', added=(-0.2, 0.0, 0.0), fits='no e_y'),
    Change('in a turn e_psi is not to be 0, but that of steady(curvature)', steady=1.0),
    *(
        Change(f'the curvature is read {abs(d):g} m too {"late" if d > 0.0 else "early"}', ahead=d)
        for d in (2.0, 4.0, 6.0, -2.0, -4.0)
    ),
    Change(
        'the output is 57 times too large: is it in degrees? Return radians',
        factor=pi / 180.0,
        fits='degrees',
    ),
    *(
        Change(
            f'the gains are too large: try {share:g} times these',
            factor=share,
            added=(0.0, 0.0, feedforward),
        )
        for share in (0.1, 0.03)
        for feedforward in (0.0, 1.0 - share)
    ),
    Change('e_y counts too little: try five times as much', inputs=(5.0, 1.0, 1.0)),
    Change('e_psi counts too little: try three times as much', inputs=(1.0, 3.0, 1.0)),
)


class _Law(LaneLaw):
    """A user's `Lane` that drives a plant, changed by a `Change`."""

    def __init__(self, code: LaneCode, plant: Plant, change: Change) -> None:
        super().__init__()
        assert plant.track  # noqa: S101 (there is one)
        self._track, self._plant, self._change = plant.track, plant, change
        self._steer = partial(code.steer, code.new_lane(plant.track, change.inputs[2]))

    def steer_calculate(self, e_y: float, e_psi: float, speed: float, _: object) -> float:
        """Return the steering angle [rad]."""
        by, place = self._change, self._plant.distance
        steer, steady = steady_turn(self._track.curvature(place))
        own = e_y * by.inputs[0], (e_psi - by.steady * steady) * by.inputs[1]
        output = by.factor * self._steer((*own, speed, place + by.ahead))
        added = zip(by.added, (e_y, e_psi, steer), strict=True)
        output += sum(gain * value for gain, value in added)
        return min(max(output, -self.output_max), self.output_max)


@dataclass(frozen=True)
class Drive:
    """A drive with a user's law."""

    log: TrackLog
    is_whole: bool  #: whether the car stayed on the track

    @property
    def errors(self) -> tuple[float, float]:
        """The RMS and the maximum of e_y [m]; of a car that left the track, infinite."""
        e_y = self.log.e_y
        if not self.is_whole:
            return inf, inf
        return float(np.sqrt(np.mean(e_y**2))), float(np.abs(e_y).max())

    def describe(self) -> str:
        """Return a sentence on the errors."""
        if not self.is_whole:
            return f'the car leaves the track after {self.log.s[-1]:.0f} m'
        rms, maximum = self.errors
        return f'RMS error {rms:.2f} m, at most {maximum:.2f} m'

    @property
    def table(self) -> Table:
        """The laps, as text."""
        laps, _ = track_laps_of(self.log)
        rows = [
            (
                f'{lap.number + 1}',
                f'{lap.time:.2f} s',
                f'{lap.rms:.2f} m',
                f'{lap.maximum:.2f} m',
                f'{lap.at_limit:.0%} of the steps at its limit',
            )
            for lap in [*laps.finished, laps.current][:_LAPS]
        ]
        return Table('lap by lap', ('lap', 'time', 'RMS', 'at most', 'the steering'), rows)

    def figure(self, title: str = '') -> Figure:
        """Draw the best lap beside that with barc_sim's law."""
        from barc_sim.figures.run_figures import plot  # noqa: PLC0415 (slow)

        runs = {'your Lane': self.log, 'LaneLQR': _usual()}
        figure = cast('Figure', plot(*runs.values(), labels=[*runs]))
        figure.axes[0].set_title(title, loc='left', pad=24.0)
        return figure


@cache
def _usual() -> TrackLog:
    """Return a lap with barc_sim's law."""
    return lap(speed=SPEED, laps=_LAPS, dynamics='dynamic')


def judge_lane(code: LaneCode, settings: Settings, criteria: Collection[str]) -> Iterator[Finding]:
    """Yield a finding for each criterion `lane.…`.

    What follows from a mistake is not taken off again: a later drive is without it, if that is
    better.
    """
    try:
        probes = _Probes(code)
        yield Finding('lane.signs', *probes.judge())
        mended, finding = _judge_return(code, probes)
        yield finding
        by, course = settings.thresholds, Track.named('L')
        yield _judge_laps('lane.laps', code, course, _LAPS, mended, probes, by)
        if 'lane.hidden' in criteria:
            track = hidden_track(settings.seed)
            yield _judge_laps('lane.hidden', code, track, 1, mended, None, by)
    except UserError as error:
        yield from (Finding(name, 0.0, str(error)) for name in DRIVE_LABELS if name != 'lane.delay')
    yield Finding('lane.delay', 0.0, f'the plot of e_y, and two sentences: {BY_EYE}', open=True)


def hidden_track(seed: int) -> Track:
    """Return an L of other radii, mirrored."""
    uniform = Random(f'{seed} track').uniform  # noqa: S311 (a simulation, not a secret)
    first, second, upper, lower = (round(uniform(9.0, 13.0), 1) for _ in range(4))
    rows = l_shape(first, second, upper, lower, straight=round(uniform(14.0, 20.0), 1))
    lengths, radii = zip(*rows, strict=True)
    curvatures = tuple(-1.0 / each if each else 0.0 for each in radii)
    return Track(lengths, curvatures, name='the hidden track')


class _Probes:
    """What a law does with each of its inputs alone, and the mirror image of that."""

    def __init__(self, code: LaneCode) -> None:
        self.code = code
        self.steer, steady = steady_turn(1.0 / _CIRCLE)
        turn = Track((2.0 * pi * _CIRCLE,), (1.0 / _CIRCLE,))
        rows = {'e_y': (_PROBED, 0.0), 'e_psi': (0.0, _PROBED), 'curvature': (0.0, steady)}
        self.rows = {name: (*row, SPEED, 0.0) for name, row in rows.items()}
        self.tracks = {'e_y': _STRAIGHT, 'e_psi': _STRAIGHT, 'curvature': turn}
        self.outputs = {name: self._output(name) for name in self.rows}
        self.mirrored = {name: self._output(name, -1.0) for name in self.rows}
        against = code.steer(code.new_lane(turn, -1.0), self.rows['curvature'])
        bend = self.outputs['curvature'] - against
        if abs(self.outputs['curvature'] - self.steer) <= abs(against - self.steer):
            bend = abs(bend)  # of a law with a large gain of e_psi
        #: The effect of each input; negative: it has the wrong sign.
        self.effects = {
            name: 0.5 * (self.mirrored[name] - self.outputs[name]) for name in ('e_y', 'e_psi')
        } | {'curvature': bend}

    def _output(self, name: str, sign: float = 1.0) -> float:
        e_y, e_psi, *rest = self.rows[name]
        row = (sign * e_y, sign * e_psi, *rest)
        return self.code.steer(self.code.new_lane(self.tracks[name], sign), row)

    @property
    def wrong(self) -> list[str]:
        """The inputs whose sign is wrong."""
        return [name for name, effect in self.effects.items() if effect < -_NEGLIGIBLE]

    def fits(self, change: Change) -> bool:
        """Return whether a change makes sense for this law."""
        found = {f'no {name}': abs(each) <= _NEGLIGIBLE for name, each in self.effects.items()}
        low, high = _DEGREES
        found['degrees'] = low < self.outputs['curvature'] / self.steer < high
        return not change.fits or found[change.fits]

    def place(self, name: str, *, reads: bool = False) -> str:
        """Return the line that makes the output for an input, or reads the curvature, as a text."""
        values = [1.0 / _CIRCLE, -1.0 / _CIRCLE] if reads else [self.outputs[name]]
        arguments = self.code.new_lane(self.tracks[name]), [self.rows[name]]
        line = self.code.line_of('steer', arguments, values, [])
        return f'{line}: ' if line else ''

    def judge(self) -> tuple[float, str]:
        """Return score and message on the signs and the symmetry."""
        sentences = {
            'e_y': 'left of the line (e_y > 0) it steers to the left: is the sign of e_y right?',
            'e_psi': 'where the car points to the left of the line (e_psi > 0) it steers to the '
            'left: is the sign of e_psi right?',
            'curvature': 'in a turn to the left (curvature > 0) it steers to the right: is the '
            'sign of the curvature right?',
        }
        if self.wrong:
            first = self.wrong[0]
            text = '; '.join(sentences[name] for name in self.wrong)
            place = self.place(first, reads=first == 'curvature')
            return _ONE_WRONG if len(self.wrong) < _TWO else 0.0, place + text
        if not any(abs(each) > _NEGLIGIBLE for each in self.effects.values()):
            return 0.0, f'{self.place("e_y")}the angle is the same for all errors and curvatures'
        for name, output in self.outputs.items():
            if abs(output + self.mirrored[name]) > _NEGLIGIBLE:
                return 0.5, (
                    f'{self.place(name)}the mirror image of a place does not give the opposite '
                    f'angle: {output:.6g} and {self.mirrored[name]:.6g} rad for {name}'
                )
        return 1.0, 'the signs are right, and the mirror image gives the opposite angle'


def _drive(
    code: LaneCode, track: Track, change: Change, distance: float, e_y: float = 0.0
) -> Drive:
    """Drive from a standstill, or beside the line at full speed."""
    plant = plant_of(track=track, road='flat', dynamics='dynamic')
    if e_y:
        plant.place(State(*track.place(0.0, e_y), SPEED))
    law = _Law(code, plant, change)
    log = closed_loop(
        plant, speed_reference=SPEED, distance=distance, max_duration=_MAX_DURATION, lane=law
    )
    assert isinstance(log, TrackLog)  # noqa: S101 (it has a track)
    return Drive(log, bool(log.s[-1] >= distance))


def _share(value: float, full: float, zero: float) -> float:
    return min(max((zero - value) / (zero - full), 0.0), 1.0)


def _returned(code: LaneCode, change: Change) -> tuple[float, str]:
    """Return score and message of the way back, from the side that is worse."""
    found = []
    for start, side in ((_OFF, 'left'), (-_OFF, 'right')):
        drive = _drive(code, _STRAIGHT, change, _SEEN, start)
        log = drive.log
        away = log.s[np.abs(log.e_y) > _BACK]
        over = max(float(np.max(-np.sign(start) * log.e_y)), 0.0) / _OFF
        limited = float(np.mean(np.abs(log.servo[log.s < _DISTANCE[0]]) >= STEERING_LIMIT))
        back = float(away[-1]) if drive.is_whole and away[-1] < log.s[-1] - 1.0 else inf
        score = _share(back, *_DISTANCE) * _share(over, *_OVERSHOOT) * _share(limited, *_SATURATED)
        way = f'back after {back:.0f} m' if back < inf else f'not back within {_SEEN:g} m'
        text = f'from {_OFF:g} m to the {side}: {way}, overshoot {over:.0%}'
        text += f', the steering at its limit in {limited:.0%} of the steps' if limited else ''
        found.append((score, text))
    return float(np.mean([score for score, _ in found])), min(found)[1]


def _judge_return(code: LaneCode, probes: _Probes) -> tuple[list[Change], Finding]:
    """Return what later drives are tried with, and the finding on the way back."""
    changes = [Change()]
    if probes.wrong:
        e_y, e_psi, bend = (-1.0 if name in probes.wrong else 1.0 for name in probes.effects)
        changes += [Change('lane.signs', (e_y, e_psi, bend), steady=each) for each in (0.0, 2.0)]
    used, (score, text) = max(
        ((each, _returned(code, each)) for each in changes), key=lambda each: each[1][0]
    )
    text = f'{_put_right(used)}{text}'
    tries = [each for each in _TRIED if score < 1.0 and probes.fits(each)]
    found = {each: _returned(code, each.on(used)) for each in tries}
    best = max(found, key=lambda each: found[each][0], default=None)
    if best and found[best][0] > score + _BETTER:
        shown = 'e_psi' if best.fits == 'no e_y' else 'e_y'  # with an output other than 0
        text = f'{probes.place(shown)}{best.sentence}. {text}. Put right: {found[best][1]}'
        equal = (each for each in tries if found[each][0] == found[best][0])
        changes += [each.on(used)._replace(sentence='lane.return') for each in equal]
    return changes, Finding('lane.return', score, text)


def _put_right(change: Change) -> str:
    return f'with what {change.sentence} names put right: ' if change.sentence else ''


def _judge_laps(
    criterion: str,
    code: LaneCode,
    track: Track,
    laps: int,
    changes: list[Change],
    probes: _Probes | None,
    by: Thresholds,
) -> Finding:
    """Return the finding on laps; with `probes`, what would be better is tried."""
    drives = {each: _drive(code, track, each, laps * track.length) for each in changes}
    used = max(drives, key=lambda each: by.score(*drives[each].errors))
    drive = drives[used]
    score = by.score(*drive.errors)
    text = f'{_put_right(used)}{drive.describe()}'
    if drive.is_whole:
        text += f' ({by.full_rms:g} and {by.full_max:g} m are full marks)'
    if probes and score < 1.0:
        tries = {
            each: _drive(code, track, each.on(used), track.length)
            for each in _TRIED
            if probes.fits(each)
        }
        best = max(tries, key=lambda each: by.score(*tries[each].errors))
        if by.score(*tries[best].errors) > score + _BETTER:
            place = probes.place(
                'curvature', reads=bool(best.ahead or (best.steady and not best.fits))
            )
            other = tries[best].describe()
            text = f'{place}{best.sentence}. {text}. Put right, in a lap: {other}'
    return Finding(criterion, score, text, drive if probes else None)


def _judge(code: LaneCode, settings: Settings, criteria: Collection[str]) -> Iterator[Finding]:
    yield from FUNCTIONS.judge(code, settings.seed)[0]
    if not DRIVE_LABELS.keys().isdisjoint(criteria):
        yield from judge_lane(code, settings, criteria)


LANE = Lab(
    handout.LANE,
    LaneCode,
    {'lane': Part({**LABELS, **DRIVE_LABELS}, _judge)},
    by_eye=frozenset({'lane.delay'}),
)
