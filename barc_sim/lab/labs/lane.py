"""Lab 3, lane keeping: the errors beside a track, the steady turn, and a class `Lane` that drives.

The mistakes in a function are in `lane.txt`. Those in `Lane` are in `lane_class.txt`: they are
known by the angles that it returns for each error and curvature alone, and their sentences stand
before what was measured in the drive.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache, partial
from math import inf
from pathlib import Path
from random import Random
from typing import TYPE_CHECKING, Any

import numpy as np

from barc_sim.control.lane import STEERING_LIMIT, LaneLaw, LaneLQR, steady_turn
from barc_sim.lab import files
from barc_sim.lab.judge import Evidence, Finding, Functions, Lab, Part, Table, share
from barc_sim.lab.law import read_law
from barc_sim.simulation.closed_loop import closed_loop, lap, plant_of
from barc_sim.simulation.log import TrackLog
from barc_sim.simulation.metrics import LAP_HEADINGS, track_laps_of
from barc_sim.vehicle.bike_model import L_F, L_R, State
from barc_sim.vehicle.track import Track, l_shape

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterator, Sequence

    from matplotlib.figure import Figure

    from barc_sim.control.lane import LaneController
    from barc_sim.lab.confined.process import JudgedCode
    from barc_sim.lab.judge import Settings, Thresholds
    from barc_sim.lab.law import Floats
    from barc_sim.vehicle.plant import Plant

    NewLaw = Callable[[Plant], LaneController]


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


LAW = replace(
    read_law(Path(__file__).with_name('lane.txt'), L_F=L_F, L_R=L_R),
    functions={'wrapped': _wrapped},
)
_RESULTS = {
    'straight_errors': ('straight_e_y', 'straight_e_psi'),
    'arc_errors': ('arc_e_y', 'arc_e_psi'),
    'steady': ('steady_delta', 'steady_e_psi'),
}
FUNCTIONS = Functions(
    LAW,
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
_CURVATURE = 0.05  #: [1/m]
_BEND = Track((50.0, 100.0), (0.0, _CURVATURE))
_SHIFT = 8  #: [m] at which the curvature may be read
_NEAR = 1e-3  #: [rad]
_ONE_WRONG = 0.2  #: of the points are left
_PUT_RIGHT = 'with LaneLQR in its place: '


def _new(code: JudgedCode, track: Track) -> int:
    """Return the number of a new `Lane` on a track."""
    return code.make('Lane', track.starts[1:], track.curvatures)


def _steer(code: JudgedCode, number: int, row: Sequence[float]) -> float:
    """Return the steering angle [rad] of a `Lane` for e_y, e_psi, speed and place."""
    return code.steps('Lane', number, [row])[0]


class _Law(LaneLaw):
    """A user's `Lane` that drives a plant."""

    def __init__(self, code: JudgedCode, plant: Plant) -> None:
        super().__init__()
        assert plant.track  # noqa: S101 (there is one)
        self._plant, self._steer = plant, partial(_steer, code, _new(code, plant.track))

    def steer_calculate(self, e_y: float, e_psi: float, speed: float, _: object) -> float:
        """Return the steering angle [rad]."""
        return self._steer((e_y, e_psi, speed, self._plant.distance))


class Probes:
    """What a law returns for each of its inputs alone, and which mistakes that shows."""

    def __init__(self, code: JudgedCode) -> None:
        """Call the law."""
        self.code = code
        self._rows: dict[str, Any] = {each.name: each.values for each in CLASS.situations['Lane']}
        self._values: dict[str, Any] = {
            name: _steer(code, *self._request(name)) for name in self._rows
        }
        self._values['late'] = self._late()

    def _request(self, name: str) -> tuple[int, tuple[Any, ...]]:
        """Return a new `Lane` in a situation, and what it is called with there."""
        *errors, curvature = map(float, self._rows[name].values())
        return _new(self.code, Track((100.0,), (curvature,))), (*errors, SPEED, 0.0)

    def _late(self) -> int:
        number = _new(self.code, _BEND)
        for d in range(-_SHIFT, _SHIFT + 1):
            steer = _steer(self.code, number, (0.0, 0.0, SPEED, 50.0 + d))
            if _near(steer, 0.5 * (self._values['level'] - self._values['level_mirrored'])):
                return d
        return 0

    def made(self, topic: str) -> list[str]:
        """Return the sentences of the mistakes of a topic that the law has."""
        return [
            self._placed(each.formulas['line']) + each.sentence.format(**self._values)
            for each in CLASS.mistakes
            if each.topic == topic
            and CLASS.compute(self._values, {'made': each.formulas['made']})['made']
        ]

    def _placed(self, name: str) -> str:
        """Return the line that returns the angle in a situation, or reads the curvature."""
        values = [self._values[name]] if name in self._rows else [_CURVATURE, -_CURVATURE]
        number, row = self._request(name if name in self._rows else 'curvature')
        line = self.code.line_of('steps', ('Lane', number, [row]), values, [])
        return f'{line}: ' if line else ''

    def judge(self) -> tuple[float, str]:
        """Return score and message on the signs and the symmetry."""
        if wrong := self.made('Signs'):
            return _ONE_WRONG if len(wrong) == 1 else 0.0, '; '.join(wrong)
        for topic, score in (('No effect', 0.0), ('Symmetry', 0.5)):
            if wrong := self.made(topic):
                return score, wrong[0]
        return 1.0, 'the signs are right, and the mirror image gives the opposite angle'

    def named(self, topic: str, text: str) -> str:
        """Return the text after the sentence of the topic's first mistake that the law has."""
        return '; '.join([*self.made(topic)[:1], text])


def _near(one: float, other: float) -> bool:
    return abs(one - other) <= _NEAR


_TURN = dict(zip(('STEER', 'STEADY'), steady_turn(_CURVATURE), strict=True))
CLASS = replace(
    read_law(Path(__file__).with_name('lane_class.txt'), CURVATURE=_CURVATURE, **_TURN),
    functions={'near': _near},
)


@cache
def _usual() -> TrackLog:
    """Return laps with barc_sim's law."""
    return lap(speed=SPEED, laps=_LAPS, dynamics='dynamic')


def judge_lane(
    code: JudgedCode, settings: Settings, criteria: Collection[str]
) -> Iterator[Finding]:
    """Yield a finding for each criterion `lane.…`.

    What follows from a mistake in the feedback is not taken off again: barc_sim's law drives, too,
    and the better drive counts.
    """
    probes, by = Probes(code), settings.thresholds
    yield Finding('lane.signs', *probes.judge())
    laws: dict[str, NewLaw] = {'': partial(_Law, code)}
    ours = {_PUT_RIGHT: lambda _: LaneLQR()}
    laws |= ours if probes.made('Signs') else {}
    score, text, whose = max((*_returned(law), whose) for whose, law in laws.items())
    if score < 1.0:
        named = probes.named('On a straight', text)
        laws |= ours if named != text and not probes.made('No effect') else {}
        text = named
    yield Finding('lane.return', score, f'{whose}{text}')
    for criterion, track, laps in (
        ('lane.laps', Track.named('L'), _LAPS),
        ('lane.hidden', hidden_track(settings.seed), 1),
    ):
        if criterion not in criteria:
            continue
        drives = {whose: _kept(law, track, laps, by) for whose, law in laws.items()}
        whose, (score, text, _) = max(drives.items(), key=lambda item: item[1][0])
        shown = None
        if criterion == 'lane.laps':
            text = probes.named('In turns', text) if score < 1.0 else text
            log = drives[''][2]
            shown = Evidence(_table(log), partial(_figure, log))
        yield Finding(criterion, score, f'{whose}{text}', shown)


def _drive(law: NewLaw, track: Track, distance: float, e_y: float = 0.0) -> TrackLog:
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


def _kept(law: NewLaw, track: Track, laps: int, by: Thresholds) -> tuple[float, str, TrackLog]:
    """Return score, message and log of laps."""
    log = _drive(law, track, laps * track.length)
    marks = f'({by.full_rms:g} and {by.full_max:g} m are full marks)'
    if abs(log.e_y[-1]) >= 0.5 * track.width:  # a drive ends at its distance, or off the track
        return 0.0, f'the car leaves the track after {log.s[-1]:.0f} m {marks}', log
    rms, maximum = float(np.sqrt(np.mean(log.e_y**2))), float(np.abs(log.e_y).max())
    return by.score(rms, maximum), f'RMS error {rms:.2f} m, at most {maximum:.2f} m {marks}', log


def _table(log: TrackLog) -> Table:
    """Return the laps, as text."""
    laps, _ = track_laps_of(log)
    shown = [*laps.finished, laps.current][:_LAPS]
    rows = [(f'{lap.number + 1}', *lap.cells) for lap in shown]
    return Table('lap by lap', ('lap', *LAP_HEADINGS), rows)


def _figure(log: TrackLog, title: str = '') -> Figure:
    """Draw the best lap beside that with barc_sim's law."""
    from barc_sim.figures.track_figure import track_figure  # noqa: PLC0415 (slow)

    return track_figure(log, _usual(), labels=['your Lane', 'LaneLQR'], title=title)


def _returned(law: NewLaw) -> tuple[float, str]:
    """Return score and message of the way back."""
    log = _drive(law, _STRAIGHT, _SEEN, _OFF)
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
    return Track.of_rows(((length, -radius) for length, radius in rows), 'the hidden track')


def _judge(code: JudgedCode, settings: Settings, criteria: Collection[str]) -> Iterator[Finding]:
    yield from FUNCTIONS.judge(code, settings.seed)[0]
    if not DRIVE_LABELS.keys().isdisjoint(criteria):
        yield from judge_lane(code, settings, criteria)


LANE = Lab(
    files.LANE,
    {'lane': Part({**LABELS, **DRIVE_LABELS}, _judge)},
    by_eye={'lane.delay': 'the plot of e_y, and two sentences'},
)
