"""Lab 3, lane keeping: the errors beside a track, the steady turn, and a class `Lane` that drives.

`lane.txt` has the common mistakes in the functions, `lane_class.txt` those in `Lane`. A mistake in
`Lane` is recognised by the angles that it returns for each error and curvature alone; its message
precedes the measurements of the drive.
"""

from __future__ import annotations

from collections import defaultdict
from functools import cache, partial
from math import inf
from random import Random
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from barc_sim.control.lane import STEERING_LIMIT, LaneLaw, LaneLQR, steady_turn
from barc_sim.lab import files
from barc_sim.lab.judge import Evidence, Finding, Functions, JudgedPart, Lab, share
from barc_sim.lab.law import read_law
from barc_sim.simulation.closed_loop import closed_loop, lap
from barc_sim.simulation.log import TrackLog
from barc_sim.simulation.metrics import LAP_HEADINGS, track_laps_of
from barc_sim.vehicle.bike_model import L_F, L_R, BicycleState
from barc_sim.vehicle.parameters import PlantOptions
from barc_sim.vehicle.track import Track, l_shape

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence

    from matplotlib.figure import Figure

    from barc_sim.control.lane import Curvature, LaneController
    from barc_sim.lab.confined.process import JudgedCode
    from barc_sim.lab.judge import Settings, Thresholds
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
DRIVE_LABELS = {
    'lane.signs': 'Lane: signs and symmetry',
    'lane.return': 'Lane: back from 1 m beside the line',
    'lane.laps': 'Lane: three laps of L',
    'lane.hidden': 'Lane: a hidden track',
    'lane.delay': 'Lane: effect of a delay',
}
_RESULTS = {
    'straight_errors': ('straight_e_y', 'straight_e_psi'),
    'arc_errors': ('arc_e_y', 'arc_e_psi'),
    'steady': ('steady_delta', 'steady_e_psi'),
}
LAW = read_law(
    'lane.txt', {'wrapped': lambda angle: np.angle(np.exp(1j * angle))}, L_F=L_F, L_R=L_R
)
_SHOWN_NAMES = {
    name: f'{name.partition("_")[2]} of {function}'
    for function, names in _RESULTS.items()
    for name in names
}
_JUDGED = [name for results in _RESULTS.values() for name in results]
FUNCTIONS = Functions(
    LAW,
    shown_names=_SHOWN_NAMES,
    results=_RESULTS,
    criteria=dict(zip(_JUDGED, LABELS, strict=True)),
)
SPEED = 6.0  #: [m/s]
_CURVATURE = 0.05  #: [1/m]
_TURN: dict[str, Any] = dict(zip(('STEER', 'STEADY'), steady_turn(_CURVATURE), strict=True))
_STRAIGHT = Track((1e4,), (0.0,))
_BEND = Track((50.0, 100.0), (0.0, _CURVATURE))
_SHIFTS = range(-8, 9)  #: [m] around the start of a turn, where `Lane` is called
_NEAR = 1e-3  #: [rad]
CLASS = read_law('lane_class.txt', CURVATURE=_CURVATURE, NEAR=_NEAR, **_TURN)
_ONE_WRONG = 0.2  #: score with one wrong sign
_LAPS = 3
_MAX_DURATION = 200.0  #: [s]
_OFFSET = 1.0  #: [m] beside the line, at the start
_BACK = 0.1  #: [m] beside the line: closer counts as back
_COURSE = 80.0  #: [m] that the car drives to come back
# Full marks up to the first, none from the second on:
_DISTANCE = (30.0, 60.0)  #: [m] until the car is back
_OVERSHOOT = (0.2, 0.6)  #: share of the distance from the line at the start
_SATURATED = (0.1, 0.5)  #: share of the steps on the first 30 m
_LARGE = 5.0  #: times the right angle in a turn: the whole output is too large
_SIGNS_CORRECTED = 'with corrected signs: '
_OUR_FEEDBACK = "with LaneLQR's gains of e_y and e_psi: "


@cache
def _reference_laps() -> TrackLog:
    """Return the laps of barc_sim's law."""
    return lap(speed=SPEED, laps=_LAPS, dynamics='dynamic')


def _new(code: JudgedCode, track: Track, sign: float = 1.0) -> int:
    """Make a new `Lane` on a track, whose curvatures have this sign; return its number."""
    curvatures = [sign * each for each in track.curvatures]
    return code.make('Lane', track.starts[1:], curvatures)


class Corrections(NamedTuple):
    """Known mistakes in a user's `Lane`, as the factors that undo them; 1 changes nothing."""

    e_y: float = 1.0  #: of the error that `Lane` gets
    e_psi: float = 1.0  #: of its difference from the one of the steady turn
    curvature: float = 1.0  #: of the curvatures that `Lane` reads
    turn: float = 1.0  #: of the angle that `Lane` returns on the line in a steady turn
    has_our_feedback: bool = False  #: LaneLQR's terms of e_y and e_psi replace the user's


class _Law(LaneLaw):
    """A user's `Lane` that drives a plant, with known mistakes corrected.

    Its steering angle is the one on the line in a steady turn, and a feedback of the errors in
    addition. A mistake in one of the two leaves the other as it is, so that what else is wrong with
    the user's law stays wrong.
    """

    def __init__(self, code: JudgedCode, correct: Corrections, plant: Plant) -> None:
        super().__init__()
        assert plant.track  # noqa: S101 (there is one)
        self._code = code
        self._whole = _new(code, plant.track, correct.curvature)
        # Has no errors, so that its state does not mix with the other's.
        self._turn = _new(code, plant.track, correct.curvature)
        self._correct = correct
        self._plant = plant
        self._ours = LaneLQR()

    def steer_calculate(
        self, e_y: float, e_psi: float, speed: float, curvature: Curvature
    ) -> float:
        """Return the steering angle [rad]."""
        correct = self._correct
        place = self._plant.distance
        steer, steady = steady_turn(curvature(0.0))

        turn = 0.0
        if correct.turn != 1.0 or correct.has_our_feedback:
            turn = self._step(self._turn, (0.0, steady, speed, place))
        if correct.has_our_feedback:
            ours = self._ours.steer_calculate(e_y, e_psi, speed, curvature)
            return correct.turn * turn + ours - steer

        inputs = correct.e_y * e_y, steady + correct.e_psi * (e_psi - steady), speed, place
        return self._step(self._whole, inputs) + (correct.turn - 1.0) * turn

    def _step(self, lane: int, inputs: tuple[float, ...]) -> float:
        """Return the angle [rad] of the user's `Lane` with this number."""
        return self._code.steps('Lane', lane, [inputs])[0]


def _values(code: JudgedCode) -> dict[str, Any]:
    """Return the angles of `Lane` by situation, and the distance by which its turns are late."""
    values: dict[str, Any] = {}
    for situation in CLASS.situations['Lane']:
        values[situation.name] = code.steps(*_call(code, situation.name))[0]

    level = 0.5 * (values['level'] - values['level_mirrored'])
    rows = [(0.0, 0.0, SPEED, 50.0 + shift) for shift in _SHIFTS]
    steers = code.steps('Lane', _new(code, _BEND), rows)
    near = [d for d, steer in zip(_SHIFTS, steers, strict=True) if abs(steer - level) <= _NEAR]
    values['late'] = near[0] if near else 0
    return values


def _call(code: JudgedCode, situation: str) -> tuple[str, int, Sequence[Any]]:
    """Return the request that calls a new `Lane` once in a situation."""
    inputs: Any = next(
        each.values for each in CLASS.situations['Lane'] if each.name == situation
    )  # numbers, no ranges
    lane = _new(code, Track((100.0,), (float(inputs['curvature']),)))
    return 'Lane', lane, [(float(inputs['e_y']), float(inputs['e_psi']), SPEED, 0.0)]


def _mistakes(code: JudgedCode, values: Mapping[str, Any]) -> Mapping[str, list[LaneMistake]]:
    """Return the mistakes in `Lane`, by topic; each message names its line if known."""
    by_topic = defaultdict(list)
    for mistake in CLASS.mistakes:
        formulas = mistake.formulas
        if not CLASS.compute(values, {'is_made': formulas['is_made']})['is_made']:
            continue
        situation = formulas['line']
        if situation in values:
            line = code.line_of('steps', _call(code, situation), [values[situation]], [])
        else:  # the line that reads the curvature
            wrong = [_CURVATURE, -_CURVATURE]
            line = code.line_of('steps', _call(code, 'curvature'), wrong, [])
        where = f'{line}: ' if line else ''
        message = f'{where}{mistake.sentence.format(**values)}'
        by_topic[mistake.topic].append(LaneMistake(message, situation))
    return by_topic


class LaneMistake(NamedTuple):
    """A mistake in a user's `Lane`."""

    message: str
    situation: str  #: that shows it; `reads` where the curvature is read wrongly


def _corrected_signs(
    mistakes: Mapping[str, list[LaneMistake]], values: Mapping[str, Any]
) -> Corrections:
    """Return the corrections of the signs that are wrong.

    With a wrong sign of the curvature, either `Lane` reads it with the wrong sign, or its result is
    subtracted: what gives the better angle in a steady turn is corrected.
    """
    wrong = {mistake.situation for mistake in mistakes['Signs']}
    correct = Corrections(-1.0 if 'e_y' in wrong else 1.0, -1.0 if 'e_psi' in wrong else 1.0)
    if 'reads' not in wrong:
        return correct
    if abs(values['against'] - _TURN['STEER']) <= abs(-_turn(values) - _TURN['STEER']):
        return correct._replace(curvature=-1.0)
    return correct._replace(turn=-1.0)


def _with_our_feedback(correct: Corrections, values: Mapping[str, Any]) -> Corrections:
    """Return the corrections with LaneLQR's feedback; a much too large output is scaled."""
    angle = values['against'] if correct.curvature < 0.0 else _turn(values)
    scale = abs(angle) / _TURN['STEER']
    turn = correct.turn / scale if scale > _LARGE else correct.turn
    return correct._replace(turn=turn, has_our_feedback=True)


def _turn(values: Mapping[str, Any]) -> float:
    """Return the steering angle [rad] on the line in a steady turn to the left."""
    return 0.5 * float(values['curvature'] - values['curvature_mirrored'])


def _judge_signs(mistakes: Mapping[str, list[LaneMistake]]) -> tuple[float, str]:
    """Judge the signs and the symmetry; return score and message."""
    wrong = mistakes['Signs']
    if wrong:
        score = _ONE_WRONG if len(wrong) == 1 else 0.0
        return score, '; '.join(mistake.message for mistake in wrong)
    if mistakes['No effect']:
        return 0.0, mistakes['No effect'][0].message
    if mistakes['Symmetry']:
        return 0.5, mistakes['Symmetry'][0].message
    return 1.0, 'the signs are right, and mirrored inputs give the opposite angle'


def _judge(code: JudgedCode, settings: Settings) -> Iterator[Finding]:
    """Yield a finding for each criterion.

    A mistake in signs or feedback costs points only once: the user's own law drives on, with this
    mistake corrected. It never drives better than it would have without the mistake.
    """
    findings, _ = FUNCTIONS.judge(code, settings.seed, settings.points)
    yield from findings

    values = _values(code)
    mistakes = _mistakes(code, values)
    score, text = _judge_signs(mistakes)
    yield Finding('lane.signs', score, text)

    correct = _corrected_signs(mistakes, values)
    remark = ''
    if mistakes['Signs']:
        remark = _SIGNS_CORRECTED
    score, text = _judge_return(partial(_Law, code, correct))
    if score < 1.0:
        text = _after_first(mistakes['On a straight'], text)
    yield Finding('lane.return', score, f'{remark}{text}')

    if mistakes['On a straight'] and not mistakes['No effect'] and score < 1.0:
        correct = _with_our_feedback(correct, values)
        remark = f'{remark}{_OUR_FEEDBACK}'
    by = settings.thresholds
    track = Track.named('L')
    score, text, evidence = _judge_laps(partial(_Law, code, correct), track, _LAPS, by)
    if score < 1.0:
        text = _after_first(mistakes['In turns'], text)
    if remark:  # the figure shows the user's own law
        _, _, evidence = _judge_laps(partial(_Law, code, Corrections()), track, _LAPS, by)
    yield Finding('lane.laps', score, f'{remark}{text}', evidence)

    track = hidden_track(settings.seed)
    score, text, _ = _judge_laps(partial(_Law, code, correct), track, 1, by)
    yield Finding('lane.hidden', score, f'{remark}{text}')


def _after_first(mistakes: Sequence[LaneMistake], text: str) -> str:
    """Return a text after the message on the first mistake, if there is one."""
    return f'{mistakes[0].message}; {text}' if mistakes else text


def _drive(law: NewLaw, track: Track, distance: float, e_y: float = 0.0) -> TrackLog:
    """Drive with a law: from a standstill, or from `e_y` [m] beside the line at full speed."""
    plant = PlantOptions(track=track, dynamics='dynamic').plant()
    if e_y:
        pose = track.place(0.0, e_y)
        plant.place(BicycleState(pose.x, pose.y, pose.psi, SPEED))
    log = closed_loop(
        plant,
        speed_reference=SPEED,
        distance=distance,
        max_duration=_MAX_DURATION,
        lane=law(plant),
    )
    assert isinstance(log, TrackLog)  # noqa: S101 (it has a track)
    return log


def _judge_return(law: NewLaw) -> tuple[float, str]:
    """Judge how the car returns to the line; return score and message."""
    log = _drive(law, _STRAIGHT, _COURSE, _OFFSET)
    away = log.s[np.abs(log.e_y) > _BACK]
    over = max(-float(log.e_y.min()), 0.0) / _OFFSET
    near = log.servo[log.s < _DISTANCE[0]]
    limited = float(np.mean(np.abs(near) >= STEERING_LIMIT))
    back = float(away[-1]) if away[-1] < log.s[-1] - 1.0 else inf
    score = share(back, *_DISTANCE) * share(over, *_OVERSHOOT) * share(limited, *_SATURATED)

    way = f'back after {back:.0f} m' if back < inf else f'not back within {_COURSE:g} m'
    marks = f'(full marks up to {_DISTANCE[0]:g} m and {_OVERSHOOT[0]:.0%})'
    text = f'{way}, overshoot {over:.0%} {marks}'
    if limited:
        text += f', the steering at its limit in {limited:.0%} of the steps'
    return score, text


def _judge_laps(
    law: NewLaw, track: Track, laps: int, by: Thresholds
) -> tuple[float, str, Evidence]:
    """Judge how close to the line the car stays in laps; return score, message and evidence."""
    log = _drive(law, track, laps * track.length)
    all_laps, _ = track_laps_of(log)
    rows = [each.cells for each in [*all_laps.finished, all_laps.current]]
    evidence = Evidence('lap by lap', LAP_HEADINGS, rows[:laps], partial(_figure, log))

    marks = f'(full marks up to {by.full_rms:g} and {by.full_max:g} m)'
    if abs(log.e_y[-1]) >= 0.5 * track.width:  # a drive ends at its distance, or off the track
        return 0.0, f'the car leaves the track after {log.s[-1]:.0f} m {marks}', evidence
    rms = float(np.sqrt(np.mean(log.e_y**2)))
    maximum = float(np.abs(log.e_y).max())
    text = f'RMS error {rms:.2f} m, maximum {maximum:.2f} m {marks}'
    return by.score(rms, maximum), text, evidence


def _figure(log: TrackLog, title: str = '') -> Figure:
    """Draw the best lap beside the best lap of barc_sim's law."""
    from barc_sim.figures.track_figure import track_figure  # noqa: PLC0415 (slow)

    return track_figure(log, _reference_laps(), labels=['your Lane', 'LaneLQR'], title=title)


def hidden_track(seed: int) -> Track:
    """Return the hidden track of a seed: a mirrored L with other radii."""
    uniform = Random(f'{seed} track').uniform  # noqa: S311 (a simulation, not a secret)
    radii = [round(uniform(9.0, 13.0), 1) for _ in range(4)]
    rows = l_shape(radii, straight=round(uniform(14.0, 20.0), 1))
    return Track.of_rows(((length, -radius) for length, radius in rows), 'the hidden track')


LANE = Lab(
    files.LANE,
    {'lane': JudgedPart({**LABELS, **DRIVE_LABELS}, _judge)},
    by_eye={'lane.delay': 'the plot of e_y, and two sentences'},
)
