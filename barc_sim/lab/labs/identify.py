"""Lab 5, identification: judges 60 s of commands, and an estimate of the car's parameters."""

from __future__ import annotations

from contextlib import suppress
from functools import lru_cache, partial
from itertools import starmap
from math import inf
from random import Random
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from barc_sim.errors import UserError
from barc_sim.interfaces.records import Command
from barc_sim.lab import files
from barc_sim.lab.judge import Evidence, Finding, Functions, JudgedPart, Lab, share
from barc_sim.lab.law import read_law
from barc_sim.lab.own_estimate import UNITS
from barc_sim.lab.user_code.adapters import COMMANDS
from barc_sim.tuning.identification import covariance
from barc_sim.vehicle.bike_model import Vehicle
from barc_sim.vehicle.plant import Actuator, Plant
from barc_sim.vehicle.road import Road

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from matplotlib.figure import Figure

    from barc_sim.lab.confined.process import JudgedCode
    from barc_sim.lab.judge import Settings, Trial
    from barc_sim.lab.law import Floats

LABELS = {
    'commands.limits': 'Commands: within the limits',
    'commands.drag': 'Commands: information on the drag',
    'commands.friction': 'Commands: information on the friction',
    'commands.delay': 'Commands: information on the delay',
    'estimate.drag': 'Estimate: drag',
    'estimate.friction': 'Estimate: friction',
    'estimate.delay': 'Estimate: delay',
    'estimate.intervals': 'Estimate: intervals of 95 %',
    'estimate.residuals': 'Estimate: residuals',
}

TS = 0.02  #: [s]
NOISE = 0.03  #: [m/s] of the measured speed
_MAX_COMMAND = 2.0  #: [m/s²]
_MAX_SPEED = 15.0  #: [m/s]
_FORCE = 100.0  #: [m/s²] More is probably a force.
_MAX_OUTPUT = 1e6  #: [m/s²] No car can drive with more.
_T = [k * TS for k in range(round(COMMANDS / TS))]  #: [s]
_CARS = 5  #: hidden cars
_SIGMAS = 1.96  #: standard deviations in an interval of 95 %
_WRONG = 0.05  #: share of the true value by which a right estimate may be off
_FULL_SHARE = 0.8  #: of the intervals contain the true value: full marks
_WIDE = 3.0  #: times the smallest possible interval: full marks


class Hint(NamedTuple):
    """A hint on the width of the intervals."""

    max_width: float  #: in smallest possible intervals
    max_score: float
    text: str


#: The first one whose width is not exceeded is used.
_HINTS = (
    Hint(0.0, 0.0, '; the true value lies within estimate ± interval: return intervals above 0'),
    Hint(0.35, 1.0, '; too narrow: is it a variance?'),
    Hint(0.7, 0.6, '; is it one standard deviation? An interval of 95 % has 1.96 of them'),
    Hint(_WIDE, 1.0, ''),
    Hint(inf, 1.0, '; too wide'),
)
_BY_CHANCE = (
    'command gives another value when it is called again with the same t: does it use random '
    'numbers, or count its calls? Its first values are judged'
)
_STEP = {'drag': 1e-6, 'friction': 1e-4, 'delay': 1e-3}  #: of the finite differences
#: Smallest interval that a drive allows: full marks up to the first, none from the second on.
_INFORMATION = {'drag': (8e-6, 3e-5), 'friction': (1e-3, 5e-3), 'delay': (1e-3, 4e-3)}


class UnknownCar(NamedTuple):
    """A car to identify: a_0/m [1/m] and F_f/m [m/s²], and the motor's delay [s]."""

    drag: float
    friction: float
    delay: float

    def __str__(self) -> str:
        """Return the text that seeds noise and test cases: the points of a course depend on it."""
        return f'Car(drag={self.drag!r}, friction={self.friction!r}, delay={self.delay!r})'

    @property
    def vehicle(self) -> Vehicle:
        """The vehicle with these resistances."""
        mass = Vehicle().mass
        return Vehicle(air_drag_coeff=self.drag * mass, friction=self.friction * mass)

    def intervals(self, commands: Sequence[float]) -> Floats:
        """Return the smallest 95 % interval that these commands allow, for each parameter.

        It is the Cramér-Rao bound; infinite for a parameter without effect on the speeds.
        """
        speeds = driven(self, commands)
        cars = [self._replace(**{n: getattr(self, n) + step}) for n, step in _STEP.items()]
        changes = np.column_stack([driven(car, commands) - speeds for car in cars])
        deviations: Floats = np.sqrt(np.diag(covariance(changes / [*_STEP.values()])))
        return _SIGMAS * NOISE * deviations


def driven(car: UnknownCar, commands: Sequence[float]) -> Floats:
    """Return the true speed [m/s] at each command, of a car that starts from a standstill."""
    plant = Plant(road=Road.flat(), vehicle=car.vehicle, motor=Actuator(delay=car.delay))
    speeds = []
    for command in commands:
        speeds.append(plant.motion().v_x)
        plant.advance(Command(command, 0.0))
    return np.array(speeds)


def _usual() -> tuple[float, ...]:
    """Return commands with information on all parameters: a coast-down, then two random values."""
    draw = Random('commands').choice  # noqa: S311 (a simulation, not a secret)
    commands = [2.0] * 350 + [0.0] * 1400
    while len(commands) < len(_T):
        commands += [draw((-1.9, 2.0))] * 15
    return tuple(commands[: len(_T)])


_USUAL = _usual()


@lru_cache(64)
def measured(car: UnknownCar, commands: tuple[float, ...] = _USUAL) -> list[float]:
    """Return the measured speeds [m/s] of a drive, with the same noise each time."""
    noise = Random(str(car)).gauss  # noqa: S311 (as above)
    return [float(v) + noise(0.0, NOISE) for v in driven(car, commands)]


def speeds_of(*parameters: Floats) -> Floats:
    """Return the measured speeds [m/s] of cars with these parameters, a row for each car."""
    return np.array(
        [measured(car) for car in starmap(UnknownCar, np.transpose(parameters).tolist())]
    )


LAW = read_law(
    'identify.txt',
    {'speeds_of': speeds_of, 'TIMES': np.array(_T), 'COMMANDS': np.array(_USUAL)},
)


def car_of(name: str) -> UnknownCar:
    """Return the car of the student with this name, which can have any characters."""
    seed = name.encode(errors='backslashreplace').decode()
    inputs = LAW.situations['estimate'][0].inputs(seed, 1)
    return UnknownCar(*(float(values[0]) for values in inputs.values()))


_RESULTS = tuple(name + kind for name in UnknownCar._fields for kind in ('', '_interval'))
FUNCTIONS = Functions(
    LAW,
    results={'estimate': _RESULTS},
    criteria={name: f'estimate.{name}' for name in UnknownCar._fields},
    count=_CARS,
    agree=partial(np.allclose, rtol=_WRONG, atol=0.0),
)


def evidence_of(car: UnknownCar, commands: Sequence[float], estimate: Sequence[float]) -> Evidence:
    """Return the evidence of a drive of the student's car: true and estimated parameters.

    `estimate` has three parameters, each followed by its interval.
    """
    smallest = car.intervals(commands)
    rows = []
    for k, (name, unit) in enumerate(UNITS.items()):
        true_value = getattr(car, name)
        value = estimate[2 * k]
        interval = estimate[2 * k + 1]
        row = (
            name,
            f'{true_value:.4g} {unit}',
            f'{value:.4g} ± {interval:.2g}',
            f'± {smallest[k]:.2g}',
            'yes' if abs(value - true_value) <= interval else 'no',
        )
        rows.append(row)
    header = ('', 'true value', 'your estimate', 'best possible', 'true value in your interval')

    def figure(title: str) -> Figure:
        return _figure(car, commands, estimate, title)

    return Evidence('your car, with your commands', header, rows, figure)


def _figure(
    car: UnknownCar, commands: Sequence[float], estimate: Sequence[float], title: str = ''
) -> Figure:
    """Draw the speed, the speed of the estimated car, and the residuals."""
    from barc_sim.figures.run_figures import identification_figure  # noqa: PLC0415 (slow)

    estimated_car = UnknownCar(*(min(max(value, 0.0), 0.4) for value in estimate[::2]))
    predicted = driven(estimated_car, commands)
    speeds = np.array(_T), np.array(measured(car, tuple(commands))), predicted
    return identification_figure({'v_x': speeds}, title=title)


def _judge(code: JudgedCode, settings: Settings) -> Iterator[Finding]:
    """Yield a finding for each criterion; the cars follow from the seed and the name."""
    car = car_of(code.call('name'))
    findings, trials = FUNCTIONS.judge(code, f'{settings.seed} {car}', settings.points)
    yield from findings

    trial = trials[0]
    if trial.failure:
        yield Finding('estimate.intervals', 0.0, trial.failure)
    else:
        score, text = _judge_intervals(trial)
        yield Finding('estimate.intervals', score, text)

    commands = _commands(code)  # an error costs the criteria on the commands
    evidence = None
    with suppress(UserError):
        row = [_T, measured(car, commands), commands]
        evidence = evidence_of(car, commands, code.rows('estimate', [row])[0])
    score, text = _judge_limits(car, commands)
    if _commands(code) != commands:
        text = f'{text}; {_BY_CHANCE}'
    yield Finding('commands.limits', score, text, evidence)
    yield from _judge_information(car, commands)


def _commands(code: JudgedCode) -> tuple[float, ...]:
    """Return the commands [m/s²] of 60 s; a UserError if no car can drive with them."""
    commands: list[float] = code.call('functions', 'command', [[t] for t in _T])
    size = max(map(abs, commands))
    if size > _MAX_OUTPUT:
        raise UserError(f'command returned {size:.3g} m/s²; expected at most {_MAX_OUTPUT:g}')
    return tuple(commands)


def _judge_limits(car: UnknownCar, commands: Sequence[float]) -> tuple[float, str]:
    """Judge the size of the commands, and the speeds that they give."""
    speeds = driven(car, commands)
    slow = float(speeds.min())
    fast = float(speeds.max())
    sizes = np.abs(commands)
    size = float(sizes.max())

    first = _T[int(np.argmax(sizes > _MAX_COMMAND + 1e-9))]
    force = ': is it a force? Return an acceleration' if size > _FORCE else ''
    too_large = f'the command reaches {size:.3g} m/s², but only {_MAX_COMMAND:g} m/s² are allowed; '
    too_large += f'it is too large from {first:.2f} s on{force}'
    too_fast = f'the car reaches {fast:.1f} m/s, but only {_MAX_SPEED:g} m/s are allowed'
    checks = (
        (size > _MAX_COMMAND + 1e-9, too_large),
        (fast > _MAX_SPEED, too_fast),
        (slow < -0.05, f'the car drives backwards, at up to {-slow:.1f} m/s'),  # noqa: PLR2004
        (not speeds.any(), 'the car does not move'),
    )
    faults = [text for is_fault, text in checks if is_fault]
    text = '; '.join(faults) or f'the command reaches {size:.3g} m/s², the car {fast:.1f} m/s'
    return max(1.0 - 0.5 * len(faults), 0.0), text


def _judge_information(car: UnknownCar, commands: Sequence[float]) -> Iterator[Finding]:
    """Judge the information in the commands: the smallest intervals of an estimate from them."""
    smallest = car.intervals(np.clip(commands, -_MAX_COMMAND, _MAX_COMMAND).tolist())
    for (name, limits), best in zip(_INFORMATION.items(), smallest.tolist(), strict=True):
        full, zero = limits
        interval = f'is ± {best:.2g} {UNITS[name]}' if best < inf else 'is infinite'
        text = f'the best possible interval of the {name} {interval} (full marks up to ± {full:g})'
        yield Finding(f'commands.{name}', share(best, full, zero), text)


@np.errstate(all='ignore')  # user code can return numbers of any size
def _judge_intervals(trial: Trial) -> tuple[float, str]:
    """Judge whether the intervals contain the true values, and are not too wide.

    An interval counts where its estimate is right: a wider one around a wrong estimate gives no
    points. Swapped results cost points only once: their intervals are judged in the right order.
    """
    got = np.column_stack([*trial.got.values()]).reshape(-1, 3, 2)
    if _are_swapped(trial):
        got = got[:, [1, 0, 2]]
    values, intervals = got.transpose(2, 0, 1)
    true = np.column_stack([*trial.inputs.values()])

    is_estimated = np.ptp(values, axis=0) > 0.0  # a constant is near the true value by chance
    is_right = is_estimated & np.isclose(values, true, rtol=_WRONG, atol=0.0)
    is_inside = np.abs(values - true) <= intervals
    inside = float(np.mean(is_right & is_inside))

    best = np.array([car.intervals(_USUAL) for car in starmap(UnknownCar, true.tolist())])
    width = float(np.median(intervals / best))
    hint = next(hint for hint in _HINTS if width <= hint.max_width)
    score = share(-inside, -_FULL_SHARE, 0.0) * _WIDE / max(width, _WIDE)

    text = f'{inside:.0%} of the intervals contain the true value'
    if not is_right.all():
        text += f', around an estimate that is within {_WRONG:.0%} of it'
    text += f'; their size is {width:.2g} times the smallest possible one{hint.text}'
    return min(score, hint.max_score), text


def _are_swapped(trial: Trial) -> bool:
    """Return whether drag or friction is returned in place of the other."""
    pairs = (('drag', 'friction'), ('friction', 'drag'))
    return any(FUNCTIONS.agree(trial.got[name], trial.right[other]) for name, other in pairs)


IDENTIFY = Lab(
    files.IDENTIFY,
    {'identify': JudgedPart(LABELS, _judge)},
    by_eye={'estimate.residuals': 'the plot of the residuals, and two sentences'},
)
