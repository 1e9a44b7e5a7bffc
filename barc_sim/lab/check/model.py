"""Judges `bikeFE`: each equation in seeded states, and a whole drive.

No state passes through zero speed within a step: sensible models differ there. The reference holds
the car at a standstill; the lab's equation does not.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from math import degrees, hypot, isfinite, pi, radians, sin
from typing import TYPE_CHECKING

import numpy as np

from barc_sim.errors import UserError
from barc_sim.lab.check.bike_mistakes import BIKE, EQUATIONS
from barc_sim.lab.check.code import Row
from barc_sim.lab.check.findings import NOT_A_CAR, Finding, Trajectory, judges
from barc_sim.lab.check.laws import Situation
from barc_sim.simulation.closed_loop import closed_loop
from barc_sim.vehicle.bike_model import L_F, L_R, Command, State, Vehicle, bikeFE
from barc_sim.vehicle.plant import Plant

if TYPE_CHECKING:
    from collections.abc import Sequence

    from barc_sim.lab.check.code import JudgedCode
    from barc_sim.lab.check.findings import Judged
    from barc_sim.lab.check.laws import Floats, Range

TS = 0.02  #: [s]
_LAB = Vehicle()
#: A car that coasts on the flat; in the order of bikeFE's arguments.
_COASTING: dict[str, Range] = {
    'x': (-200.0, 200.0),  # [m]
    'y': (-50.0, 50.0),  # [m]
    'psi': (-pi, pi),  # [rad]
    'v': (3.0, 20.0),  # [m/s]
    'a': (0.0, 0.0),  # [m/s²]
    'd_f': (0.0, 0.0),  # [rad]
    'a0': (0.0, 0.0),  # [N s²/m²]
    'm': (_LAB.mass, _LAB.mass),  # [kg]
    'Ff': (0.0, 0.0),  # [N]
    'theta': (0.0, 0.0),  # [rad]
    'ts': (TS, TS),  # [s]
}


def _situation(
    name: str, concerns: str, *, l_f: float = L_F, l_r: float = L_R, **ranges: Range
) -> Situation:
    return Situation(name, concerns, {**_COASTING, **ranges}, {'l_f': l_f, 'l_r': l_r})


_LEFT, _RIGHT, _STEERED = (0.05, 0.5), (-0.5, -0.05), (-0.5, 0.5)
_COMMAND, _DRAG, _FRICTION = (1.0, 8.0), (0.1, 2.0), (20.0, 500.0)
_BACKWARDS = (-15.0, -3.0)
_UPHILL, _DOWNHILL, _HILLS = (
    (radians(low), radians(high)) for low, high in ((2.0, 30.0), (-30.0, -2.0), (-30.0, 30.0))
)
_TURN = _situation('a left turn', 'x y psi', d_f=_LEFT)

SITUATIONS = (
    _situation('coasting along the x axis', 'x', psi=(0.0, 0.0)),
    _situation('accelerating on the flat', 'x y v', a=_COMMAND),
    _situation('braking on the flat', 'v', a=(-8.0, -1.0)),
    # Without drag and friction, because models differ in sign(0).
    _situation('setting off', 'v', v=(0.0, 0.0), a=_COMMAND),
    _TURN,
    _situation('a right turn', 'x y psi', d_f=_RIGHT),
    _situation('uphill', 'v', theta=_UPHILL),
    _situation('downhill', 'v', theta=_DOWNHILL),
    _situation('rolling friction', 'v', Ff=_FRICTION),
    _situation('air drag', 'v', a0=_DRAG),
    _situation(
        "the lab's car on hills",
        'x y psi v',
        a=(-8.0, 8.0),
        d_f=_STEERED,
        a0=(_LAB.air_drag_coeff, _LAB.air_drag_coeff),
        Ff=(_LAB.friction, _LAB.friction),
        theta=_HILLS,
    ),
)
#: The lab's road has none of these.
REVERSE = (
    _situation('reversing to the left', 'x y psi', v=_BACKWARDS, d_f=_LEFT),
    _situation('reversing to the right', 'x y psi', v=_BACKWARDS, d_f=_RIGHT),
    _situation('drag and friction in reverse', 'v', v=_BACKWARDS, a0=_DRAG, Ff=_FRICTION),
    _situation('rolling back on a hill', 'v', v=_BACKWARDS, Ff=_FRICTION, theta=_UPHILL),
)
GENERAL = (
    _situation(
        'another mass and time step',
        'x y psi v',
        v=(4.0, 20.0),
        a=(-4.0, 8.0),
        d_f=_STEERED,
        a0=_DRAG,
        m=(500.0, 3000.0),
        Ff=_FRICTION,
        theta=_HILLS,
        ts=(0.005, 0.1),
    ),
)


def with_lengths(l_f: float, l_r: float) -> Situation:
    """Return the situation for a function that takes the axle distances [m]."""
    return _situation('axles at other distances', 'x y psi', l_f=l_f, l_r=l_r, d_f=_STEERED)


def states(situation: Situation, seed: int, count: int = 250) -> list[Row]:
    """Return the arguments of `bikeFE` in `count` states."""
    return [Row(*values) for values in situation.rows(seed, count)]


#: Relative to max(|expected|, 1): far above rounding errors, far below any mistake.
_TOLERANCE = 1e-9
#: After so many failures the code is not called again: each call can use its whole time budget.
_MAX_FAILURES = 4
_OTHER_L_F, _OTHER_L_R = 1.2, 1.9  #: [m]


def close(got: Floats, expected: Floats) -> Floats:
    """Return where `got` equals `expected`, to rounding; False where it is not finite."""
    with np.errstate(invalid='ignore', over='ignore'):
        near = np.abs(got - expected) <= _TOLERANCE * np.maximum(1.0, np.abs(expected))
    return np.asarray(near & np.isfinite(got), dtype=np.bool_)


@dataclass(eq=False)
class Results:
    """The states of one situation, with the expected and the actual results."""

    situation: Situation
    rows: list[Row]
    expected: Floats  #: shape `(n, 4)`
    got: Floats  #: shape `(n, 4)`, NaN if the code failed
    failure: str = ''

    def right(self, name: str) -> Floats:
        """Return the states in which the equation of `name` is right, shape `(n,)`."""
        column = EQUATIONS.index(name)
        return close(self.got[:, column], self.expected[:, column])


def _run(code: JudgedCode, seed: int, situations: Sequence[Situation]) -> list[Results]:
    """Call `bikeFE` in all of the `situations`."""
    results: list[Results] = []
    for situation in situations:
        rows, lengths = states(situation, seed), situation.fixed
        expected = np.array([bikeFE(*row, **lengths) for row in rows])
        part = Results(situation, rows, expected, np.full_like(expected, np.nan))
        results.append(part)
        failures = [other.failure for other in results if other.failure]
        if len(failures) >= _MAX_FAILURES:
            part.failure = failures[-1]
            continue
        try:
            part.got = np.array(code.bike_fe(rows, **lengths), dtype=np.float64)
        except UserError as error:
            part.failure = str(error)
    return results


def _at_other_lengths(code: JudgedCode, seed: int) -> tuple[Situation, ...]:
    """Return the situation at other axle distances, those that the function takes."""
    rows = states(_TURN, seed)
    try:
        usual = code.bike_fe(rows)
    except UserError:
        return ()
    try:
        l_f = L_F if code.bike_fe(rows, l_f=_OTHER_L_F) == usual else _OTHER_L_F
        l_r = L_R if code.bike_fe(rows, l_r=_OTHER_L_R) == usual else _OTHER_L_R
    except UserError:
        l_f, l_r = _OTHER_L_F, _OTHER_L_R
    return () if (l_f, l_r) == (L_F, L_R) else (with_lengths(l_f, l_r),)


@np.errstate(all='ignore')
def judge_equations(code: JudgedCode, seed: int) -> list[Finding]:
    """Return a finding for each of the four equations, in states of the lab's road.

    An equation's score is a product. The first factor is the share of states in which it is right,
    as a mean over the situations that test it. The second is the same share over all other
    situations.
    """
    results = _run(code, seed, SITUATIONS)
    random = _randomness(code, results)
    scores = {name: _score(results, name) for name in EQUATIONS}
    wrong = [name for name in EQUATIONS if scores[name] < 1.0]
    sentences = {} if random else _sentences(results, wrong)
    return [
        Finding(
            f'model.{name}',
            0.0 if random else scores[name],
            random or sentences.get(name) or _right(results),
        )
        for name in EQUATIONS
    ]


@judges('model.reverse')
def judge_reverse(code: JudgedCode, seed: int) -> Judged:
    """Return the finding on all equations together, at negative speeds."""
    return _judge_beyond(code, seed, REVERSE)


@judges('model.general')
def judge_general(code: JudgedCode, seed: int) -> Judged:
    """Return the finding on all equations together, with another car.

    Other axle distances are tried only if the function takes them.
    """
    return _judge_beyond(code, seed, (*GENERAL, *_at_other_lengths(code, seed)))


def _judge_beyond(code: JudgedCode, seed: int, situations: Sequence[Situation]) -> Judged:
    """Judge the results in states that the lab's road has not."""
    results = _run(code, seed, situations)
    score = float(np.mean([part.right(name).mean() for part in results for name in EQUATIONS]))
    wrong = [name for name in EQUATIONS if _score(results, name) < 1.0]
    if not wrong:
        return score, _right(results)
    # A cause must explain the results on the lab's road, too.
    return score, _sentences(results, wrong[:1], _run(code, seed, SITUATIONS))[wrong[0]]


def _score(results: Sequence[Results], name: str) -> float:
    tested: list[float] = []
    other: list[float] = []
    for part in results:
        share = float(part.right(name).mean())
        (tested if name in part.situation.concerns.split() else other).append(share)
    return float(np.mean(tested or [1.0]) * np.mean(other or [1.0]))


def _right(results: Sequence[Results]) -> str:
    return f'right in all {sum(len(part.rows) for part in results):,} states'


def _sentences(
    results: Sequence[Results], wrong: Sequence[str], others: Sequence[Results] = ()
) -> dict[str, str]:
    """Return a sentence for each wrong equation: the failure, the mistake, or the largest error."""
    if failed := [part for part in results if part.failure]:
        where = '' if len(failed) == len(results) else f' ({failed[0].situation.name})'
        failure = f'{failed[0].failure}{where}'
        return dict.fromkeys(wrong, failure)
    named = _mistakes([part for part in (*others, *results) if not part.failure], wrong)
    return {name: named.get(name) or _largest(results, name) for name in wrong}


def _mistakes(results: Sequence[Results], wrong: Sequence[str]) -> dict[str, str]:
    """Return the sentence of the mistake in each wrong equation, if the table has it."""
    rows = [{**row._asdict(), **part.situation.fixed} for part in results for row in part.rows]
    inputs = {name: np.array([row[name] for row in rows]) for name in rows[0]}
    got = np.concatenate([part.got for part in results]).T
    found = BIKE.explain(
        inputs,
        {f'{name}_next': values for name, values in zip(EQUATIONS, got, strict=True)},
        [f'{name}_next' for name in wrong],
        lambda one, other: bool(close(one, other).all()),
    )
    return {name.removesuffix('_next'): sentence for name, sentence in found.items()}


def _largest(results: Sequence[Results], name: str) -> str:
    """Return a sentence on where an equation is wrong, and on its largest error."""
    bad = [part.situation.name for part in results if not part.right(name).all()]
    where = 'everywhere' if len(bad) == len(results) else f'in: {", ".join(bad)}'
    column = EQUATIONS.index(name)
    errors = [np.abs(part.got[:, column] - part.expected[:, column]) for part in results]
    part, error = max(zip(results, errors, strict=True), key=lambda item: float(item[1].max()))
    row = int(error.argmax())
    return (
        f'{name}_next is wrong {where}. The largest error: {_call_text(part.rows[row])} gave '
        f'{part.got[row, column]:.9g}, expected {part.expected[row, column]:.9g}'
    )


def _randomness(code: JudgedCode, results: Sequence[Results]) -> str:
    """Return a message if the same arguments give different results, else an empty string."""
    part = next((part for part in results if not part.failure), None)
    if part is None:
        return ''
    try:
        again = np.array(code.bike_fe(part.rows), dtype=np.float64)
    except UserError as error:
        return f'a second call with the same arguments fails: {error}'
    differing = np.flatnonzero(~np.all(part.got == again, axis=1))
    if not differing.size:
        return ''
    k = int(differing[0])
    first, then = ([f'{value:.9g}' for value in values[k]] for values in (part.got, again))
    return (
        'the same arguments give different results: does bikeFE use random numbers or change a '
        f'global variable? {_call_text(part.rows[k])} first gave [{", ".join(first)}], then '
        f'[{", ".join(then)}]'
    )


def _call_text(row: Row) -> str:
    values = zip(row._fields, row, strict=True)
    return f'bikeFE({", ".join(f"{name}={value:.6g}" for name, value in values)})'


#: [m, m, rad, m/s] Above the effect of friction's sign at a standstill, below that of any mistake.
_NEAR = 1e-4
_STEERING, _PACE = 0.06, 0.8  #: [rad] and [rad/s] of a slalom


@judges('model.trajectory')
def judge_trajectory(code: JudgedCode) -> Judged:
    """Return the finding on a drive over the lab's road with the commands of the reference.

    The score is the share of steps near the reference.
    """

    def model(*args: float, **_: float) -> list[float]:  # the lengths are the function's own
        return list(code.bike_fe([Row(*args)])[0])

    commands, failure = _commands(), ''
    reference, own = (np.full((len(commands), len(State._fields)), np.nan) for _ in range(2))
    _fill(reference, Plant(), commands)
    try:
        _fill(own, Plant(model=model), commands)
    except UserError as error:
        failure = str(error)
    t: Floats = np.arange(len(reference), dtype=np.float64) * Plant().ts
    off: Floats = np.abs(own - reference)
    within = np.all(off <= _NEAR, axis=1)
    # The first state is given, not computed.
    score = float(np.mean(within[1:]))
    if failure:
        message = failure
    elif score == 1.0:
        message = f'follows the reference for {t[-1]:.0f} s and {len(t) - 1:,} steps'
    else:
        message = f'leaves the reference after {t[np.argmin(within)]:.2f} s{_at_the_end(off[-1])}'
    drawn = Trajectory(t, own, reference) if np.isfinite(own[1:]).any() else None
    return score, message, drawn


@cache
def _commands() -> tuple[Command, ...]:
    """Return the commands of the reference's run over the lab's road, and a slalom."""
    log = closed_loop()
    steering = [_STEERING * sin(_PACE * t) for t in log.t.tolist()]
    return tuple(Command(*command) for command in zip(log.motor.tolist(), steering, strict=True))


def _fill(states: Floats, plant: Plant, commands: tuple[Command, ...]) -> None:
    """Write the state before each command, up to the first one beyond all limits."""
    for k, command in enumerate(commands):
        if not np.all(np.abs(plant.state) < NOT_A_CAR):
            return
        states[k] = plant.state
        plant.advance(command)


def _at_the_end(off: Floats) -> str:
    x, y, psi, v = np.nan_to_num(off, nan=np.inf)
    if not isfinite(x):
        return f', and then grows without limit: beyond {NOT_A_CAR:g} it is not a car'
    return (
        f'; at the end of the road it is {hypot(x, y):.3g} m, {degrees(psi):.3g}° and '
        f'{v:.3g} m/s away'
    )
