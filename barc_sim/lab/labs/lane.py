"""Lab 3, lane keeping: the errors beside a track, the steady turn, and a class `Lane` that drives.

A mistake in `Lane` is known by the angles that it returns for each error and curvature alone, and
its sentence stands before what was measured in the drive.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache, cached_property, partial
from itertools import count
from math import inf, pi
from pathlib import Path
from random import Random
from typing import TYPE_CHECKING, NamedTuple, cast

import numpy as np

from barc_sim.control.lane import STEERING_LIMIT, LaneController, LaneLaw, LaneLQR, steady_turn
from barc_sim.errors import UserError
from barc_sim.lab import files
from barc_sim.lab.confined.process import JudgedCode, numbers_of
from barc_sim.lab.judge import Evidence, Finding, Functions, Lab, Part, Table, read_law, share
from barc_sim.lab.user_code.folder import BY_EYE
from barc_sim.simulation.closed_loop import closed_loop, lap, plant_of
from barc_sim.simulation.log import TrackLog
from barc_sim.simulation.metrics import LAP_HEADINGS, track_laps_of
from barc_sim.vehicle.bike_model import L_F, L_R, State
from barc_sim.vehicle.track import Track, l_shape

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterator, Mapping, Sequence

    from matplotlib.figure import Figure

    from barc_sim.lab.judge import Floats, Settings
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
LAW = replace(read_law(Path(__file__).with_name('lane.txt'), L_F=L_F, L_R=L_R), functions=_FORMULAS)
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
_PROBED = 0.1  #: [m] and [rad] errors
_CURVATURE = 0.05  #: [1/m]
_STEER, _E_PSI = steady_turn(_CURVATURE)
_TURN = Track((2.0 * pi / _CURVATURE,), (_CURVATURE,))
_BEND = Track((50.0, 100.0), (0.0, _CURVATURE))
_SHIFT = 8  #: [m] at which the curvature may be read
_NEGLIGIBLE, _NEAR = 1e-6, 1e-3  #: [rad]
_ONE_WRONG = 0.2  #: of the points are left
_PUT_RIGHT = 'with LaneLQR in its place: '


class LaneCode(JudgedCode):
    """A user's `lane.py`."""

    _lanes = count()

    def new_lane(self, track: Track, sign: float = 1.0) -> int:
        """Return the number of a new `Lane` on a track; its file is loaded again.

        It reads the curvature times `sign`.
        """
        number = next(self._lanes)
        self.call('make_lane', number, track.starts[1:], [sign * each for each in track.curvatures])
        return number

    def steer(self, number: int, row: Sequence[float]) -> float:
        """Return the steering angle [rad] of a `Lane` for e_y, e_psi, speed and place."""
        return numbers_of('Lane', self.call('steer', number, [row]), 1)[0]


class _Law(LaneLaw):
    """A user's `Lane` that drives a plant."""

    def __init__(self, code: LaneCode, plant: Plant) -> None:
        super().__init__()
        assert plant.track  # noqa: S101 (there is one)
        self._plant, self._steer = plant, partial(code.steer, code.new_lane(plant.track))

    def steer_calculate(self, e_y: float, e_psi: float, speed: float, _: object) -> float:
        """Return the steering angle [rad]."""
        return self._steer((e_y, e_psi, speed, self._plant.distance))


_WRONG_SIGN = {
    'e_y': 'left of the line (e_y > 0) it steers to the left: is the sign of e_y right?',
    'e_psi': 'where the car points to the left of the line (e_psi > 0) it steers to the left: is '
    'the sign of e_psi right?',
    'curvature': 'in a turn to the left (curvature > 0) it steers to the right: is the sign of the '
    'curvature right?',
}


class Probes:
    """What a law returns for each of its inputs alone [rad], and the mirror image of that.

    By these numbers it is known: a mistake is a wrong law that returns the same.
    """

    def __init__(self, code: LaneCode) -> None:
        """Call the law."""
        self.code = code
        self.rows = {
            'e_y': (_STRAIGHT, _PROBED, 0.0),
            'e_psi': (_STRAIGHT, 0.0, _PROBED),
            'curvature': (_TURN, 0.0, _E_PSI),  # as in the steady turn
            'level': (_TURN, 0.0, 0.0),
        }
        self.outputs = {name: self._output(name) for name in self.rows}
        self.mirrored = {name: self._output(name, -1.0) for name in self.rows}
        half = {name: 0.5 * (each - self.mirrored[name]) for name, each in self.outputs.items()}
        #: For 1 m and 1 rad; of a law that steers back to the line they are negative.
        self.of_e_y, self.of_e_psi = half['e_y'] / _PROBED, half['e_psi'] / _PROBED
        self.in_turn, self.level = half['curvature'], half['level']
        against = code.steer(code.new_lane(_TURN, -1.0), (0.0, _E_PSI, SPEED, 0.0))
        bend = self.outputs['curvature'] - against
        if abs(self.outputs['curvature'] - _STEER) <= abs(against - _STEER):
            bend = abs(bend)  # of a law with a large gain of e_psi
        effects = {'e_y': -self.of_e_y, 'e_psi': -self.of_e_psi, 'curvature': bend}
        self.has_effect = any(abs(each) > _NEGLIGIBLE for each in effects.values())
        #: The inputs whose sign is wrong.
        self.wrong = [name for name, effect in effects.items() if effect < -_NEGLIGIBLE]

    @cached_property
    def late(self) -> int:
        """How far [m] behind the start of an arc the law begins to steer for it."""
        number = self.code.new_lane(_BEND)
        for d in range(-_SHIFT, _SHIFT + 1):
            if _near(self.code.steer(number, (0.0, 0.0, SPEED, 50.0 + d)), self.level):
                return d
        return 0

    def _output(self, name: str, sign: float = 1.0) -> float:
        track, e_y, e_psi = self.rows[name]
        number = self.code.new_lane(track, sign)
        return self.code.steer(number, (sign * e_y, sign * e_psi, SPEED, 0.0))

    def place(self, name: str, *, reads: bool = False) -> str:
        """Return the line that makes the output for an input, or reads the curvature, as a text."""
        values = [_CURVATURE, -_CURVATURE] if reads else [self.outputs[name]]
        track, *errors = self.rows[name]
        line = self.code.line_of(
            'steer', (self.code.new_lane(track), [(*errors, SPEED, 0.0)]), values, []
        )
        return f'{line}: ' if line else ''

    def judge(self) -> tuple[float, str]:
        """Return score and message on the signs and the symmetry."""
        if self.wrong:
            first, *others = self.wrong
            text = '; '.join(_WRONG_SIGN[name] for name in self.wrong)
            place = self.place(first, reads=first == 'curvature')
            return 0.0 if others else _ONE_WRONG, place + text
        if not self.has_effect:
            return 0.0, f'{self.place("e_y")}the angle is the same for all errors and curvatures'
        for name, output in self.outputs.items():
            if abs(output + self.mirrored[name]) > _NEGLIGIBLE:
                return 0.5, (
                    f'{self.place(name)}the mirror image of a place does not give the opposite '
                    f'angle: {output:.6g} and {self.mirrored[name]:.6g} rad for {name}'
                )
        return 1.0, 'the signs are right, and the mirror image gives the opposite angle'


def _near(one: float, other: float) -> bool:
    return abs(one - other) <= _NEAR


class _Mistake(NamedTuple):
    """A mistake in a law that steers to the right side."""

    sentence: str
    is_made: Callable[[Probes], bool]
    shown: str = 'e_y'  #: the input for which the line of the output is named
    reads: bool = False  #: the line that reads the curvature, instead


#: On the way back to a straight.
_ON_STRAIGHT = (
    _Mistake(
        'the output is 57 times too large: is it in degrees? Return radians',
        lambda p: 45.0 < p.in_turn / _STEER < 70.0,  # noqa: PLR2004
    ),
    _Mistake(
        'the gains are too large: the steering is at its limit for small errors',
        lambda p: p.of_e_y < -2.0 or p.of_e_psi < -6.0,  # noqa: PLR2004
    ),
    _Mistake('e_psi has no effect: add -0.6 * e_psi', lambda p: _near(p.of_e_psi, 0.0)),
    _Mistake('e_y has no effect: add -0.2 * e_y', lambda p: _near(p.of_e_y, 0.0), 'e_psi'),
    _Mistake('e_y counts too little: try five times as much', lambda p: p.of_e_y > -0.1),  # noqa: PLR2004
    _Mistake('e_psi counts too little: try three times as much', lambda p: p.of_e_psi > -0.3),  # noqa: PLR2004
)
#: In laps.
_IN_TURNS = (
    _Mistake(
        'the curvature has no effect: add the steering of steady(curvature(0.0)), and take its '
        'e_psi off e_psi',
        lambda p: _near(p.level, 0.0) and _near(p.in_turn, p.of_e_psi * _E_PSI),
        'curvature',
    ),
    _Mistake(
        'in a turn e_psi is not to be 0, but that of steady(curvature)',
        lambda p: _near(p.level, _STEER) and not _near(p.in_turn, _STEER),
        'curvature',
        reads=True,
    ),
    _Mistake('the curvature is read {0.late} m too late', lambda p: p.late > 0, 'curvature', True),
)


def _named(mistakes: Sequence[_Mistake], probes: Probes, text: str) -> str:
    """Return the text after the sentence of the mistake that is made."""
    for each in mistakes:
        if each.is_made(probes):
            place = probes.place(each.shown, reads=each.reads)
            return f'{place}{each.sentence.format(probes)}. {text}'
    return text


@cache
def _usual() -> TrackLog:
    """Return laps with barc_sim's law."""
    return lap(speed=SPEED, laps=_LAPS, dynamics='dynamic')


def judge_lane(code: LaneCode, settings: Settings, criteria: Collection[str]) -> Iterator[Finding]:
    """Yield a finding for each criterion `lane.…`.

    What follows from a mistake in the feedback is not taken off again: barc_sim's law drives, too,
    and the better drive counts.
    """
    try:
        probes, by = Probes(code), settings.thresholds
        yield Finding('lane.signs', *probes.judge())
        laws: dict[str, Callable[[Plant], LaneController]] = {'': partial(_Law, code)}
        ours = {_PUT_RIGHT: lambda _: LaneLQR()}
        laws |= ours if probes.wrong else {}
        score, text, whose = max((*_returned(law), whose) for whose, law in laws.items())
        if score < 1.0:
            named = _named(_ON_STRAIGHT, probes, text)
            laws |= ours if named != text and probes.has_effect else {}
            text = named
        yield Finding('lane.return', score, f'{whose}{text}')
        for criterion, track, laps in (
            ('lane.laps', Track.named('L'), _LAPS),
            ('lane.hidden', hidden_track(settings.seed), 1),
        ):
            if criterion not in criteria:
                continue
            way = laps * track.length
            logs = {whose: drive_law(law, track, way) for whose, law in laws.items()}
            whose, log = max(logs.items(), key=lambda item: by.score(*drive_errors(item[1])))
            score = by.score(*drive_errors(log))
            text = f'{describe(log)} ({by.full_rms:g} and {by.full_max:g} m are full marks)'
            shown = None
            if criterion == 'lane.laps':
                text = _named(_IN_TURNS, probes, text) if score < 1.0 else text
                shown = Evidence(_table(logs['']), partial(_figure, logs['']))
            yield Finding(criterion, score, f'{whose}{text}', shown)
    except UserError as error:
        yield from (Finding(name, 0.0, str(error)) for name in DRIVE_LABELS if name != 'lane.delay')
    yield Finding('lane.delay', 0.0, f'the plot of e_y, and two sentences: {BY_EYE}', open=True)


def drive_law(
    law: Callable[[Plant], LaneController], track: Track, distance: float, e_y: float = 0.0
) -> TrackLog:
    """Drive with a law from a standstill, or beside the line at full speed."""
    plant = plant_of(track=track, road='flat', dynamics='dynamic')
    if e_y:
        plant.place(State(*track.place(0.0, e_y), SPEED))
    log = closed_loop(
        plant,
        speed_reference=SPEED,
        distance=distance,
        max_duration=_MAX_DURATION,
        lane=law(plant),
    )
    assert isinstance(log, TrackLog)  # noqa: S101 (it has a track)
    return log


def drive_errors(log: TrackLog) -> tuple[float, float]:
    """Return the RMS and the maximum of e_y [m]; of a car that left the track, infinite."""
    is_on_track = np.abs(log.e_y[-1]) < 0.5 * log.width[-1]  # a drive ends at its distance, or off
    if not is_on_track:
        return inf, inf
    return float(np.sqrt(np.mean(log.e_y**2))), float(np.abs(log.e_y).max())


def describe(log: TrackLog) -> str:
    """Return a sentence on the errors."""
    rms, maximum = drive_errors(log)
    if rms == inf:
        return f'the car leaves the track after {log.s[-1]:.0f} m'
    return f'RMS error {rms:.2f} m, at most {maximum:.2f} m'


def _table(log: TrackLog) -> Table:
    """Return the laps, as text."""
    laps, _ = track_laps_of(log)
    shown = [*laps.finished, laps.current][:_LAPS]
    rows = [(f'{lap.number + 1}', *lap.cells) for lap in shown]
    return Table('lap by lap', ('lap', *LAP_HEADINGS), rows)


def _figure(log: TrackLog, title: str = '') -> Figure:
    """Draw the best lap beside that with barc_sim's law."""
    from barc_sim.figures.run_figures import plot  # noqa: PLC0415 (slow)

    figure = cast('Figure', plot(log, _usual(), labels=['your Lane', 'LaneLQR']))
    figure.axes[0].set_title(title, loc='left', pad=24.0)
    return figure


def _returned(law: Callable[[Plant], LaneController]) -> tuple[float, str]:
    """Return score and message of the way back."""
    log = drive_law(law, _STRAIGHT, _SEEN, _OFF)
    away = log.s[np.abs(log.e_y) > _BACK]
    over = max(-float(log.e_y.min()), 0.0) / _OFF
    limited = float(np.mean(np.abs(log.servo[log.s < _DISTANCE[0]]) >= STEERING_LIMIT))
    back = float(away[-1]) if away[-1] < log.s[-1] - 1.0 else inf
    score = share(back, *_DISTANCE) * share(over, *_OVERSHOOT) * share(limited, *_SATURATED)
    way = f'back after {back:.0f} m' if back < inf else f'not back within {_SEEN:g} m'
    text = f'{way}, overshoot {over:.0%}'
    text += f', the steering at its limit in {limited:.0%} of the steps' if limited else ''
    return score, text


def hidden_track(seed: int) -> Track:
    """Return an L of other radii, mirrored."""
    uniform = Random(f'{seed} track').uniform  # noqa: S311 (a simulation, not a secret)
    first, second, upper, lower = (round(uniform(9.0, 13.0), 1) for _ in range(4))
    rows = l_shape(first, second, upper, lower, straight=round(uniform(14.0, 20.0), 1))
    lengths, radii = zip(*rows, strict=True)
    curvatures = tuple(-1.0 / each if each else 0.0 for each in radii)
    return Track(lengths, curvatures, name='the hidden track')


def _judge(code: LaneCode, settings: Settings, criteria: Collection[str]) -> Iterator[Finding]:
    yield from FUNCTIONS.judge(code, settings.seed)[0]
    if not DRIVE_LABELS.keys().isdisjoint(criteria):
        yield from judge_lane(code, settings, criteria)


LANE = Lab(
    files.LANE,
    LaneCode,
    {'lane': Part({**LABELS, **DRIVE_LABELS}, _judge)},
    by_eye=frozenset({'lane.delay'}),
)
