"""Lab 5 as data: identification. 60 s of commands, and an estimate of what the car is."""

from __future__ import annotations

from dataclasses import replace
from functools import cache, lru_cache, partial
from pathlib import Path
from random import Random
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from barc_sim.errors import UserError
from barc_sim.lab import files
from barc_sim.lab.confined.process import JudgedCode, numbers_of
from barc_sim.lab.judge import Evidence, Finding, Functions, Lab, Part, Table, read_law, share
from barc_sim.lab.user_code.adapters import COMMANDS
from barc_sim.lab.user_code.folder import BY_EYE
from barc_sim.tuning.identification import covariance
from barc_sim.vehicle.bike_model import Command, Vehicle
from barc_sim.vehicle.plant import Actuator, Plant
from barc_sim.vehicle.road import Road

if TYPE_CHECKING:
    from collections.abc import Collection, Iterator, Sequence

    from matplotlib.figure import Figure

    from barc_sim.lab.judge import Floats, Inputs, Settings, Trial

LABELS = {
    'commands.limits': 'Commands: within the limits',
    'commands.drag': 'Commands: they show the drag',
    'commands.friction': 'Commands: they show the friction',
    'commands.delay': 'Commands: they show the delay',
    'estimate.drag': 'Estimate: drag',
    'estimate.friction': 'Estimate: friction',
    'estimate.delay': 'Estimate: delay',
    'estimate.intervals': 'Estimate: intervals of 95 %',
    'estimate.residuals': 'Estimate: what the residuals show',
}

TS = 0.02  #: [s]
NOISE = 0.03  #: [m/s] of the measured speed
_MAX_COMMAND, _MAX_SPEED = 2.0, 15.0  #: [m/s²] and [m/s]
_FORCE, _NOT_A_CAR = 100.0, 1e6  #: [m/s²] A larger command is a force; none can be driven.
_T = [k * TS for k in range(round(COMMANDS / TS))]  #: [s]
_CARS = 5  #: hidden ones
_SIGMAS = 1.96  #: standard deviations: 95 %
_WRONG = 0.05  #: share by which a right estimate may be off
_FULL_SHARE = 0.8  #: of the intervals that hold the truth, for full marks
_WIDTH = (0.7, 3.0)  #: times the best possible interval
_ONE_SIGMA = (0.35, 0.7)  #: the same, of one standard deviation
_UNITS = {'drag': '1/m', 'friction': 'm/s²', 'delay': 's'}
_STEP = {'drag': 1e-6, 'friction': 1e-4, 'delay': 1e-3}  #: of the differences
#: Intervals that a drive can give: full marks up to the first, none from the second on.
_SHOWN = {'drag': (8e-6, 3e-5), 'friction': (1e-3, 5e-3), 'delay': (1e-3, 4e-3)}
_ADVICE = {
    'drag': 'it differs from friction only where the speed changes much: let the car roll from a '
    'high speed to a low one',
    'friction': 'let the car roll, at low speeds, too',
    'delay': 'it shows where the command changes: change it often, and by much',
}


class Car(NamedTuple):
    """What is to be identified: resistances by mass [1/m], [m/s²], and the motor's delay [s]."""

    drag: float
    friction: float
    delay: float

    @property
    def vehicle(self) -> Vehicle:
        """The vehicle with these resistances."""
        mass = Vehicle().mass
        return Vehicle(air_drag_coeff=self.drag * mass, friction=self.friction * mass)

    def intervals(self, commands: Sequence[float]) -> Floats:
        """Return the smallest interval of 95 % that these commands allow, for each parameter.

        It is the bound of Cramér and Rao; infinite for what the drive does not show.
        """
        speeds = driven(self, tuple(commands))
        moved = [self._replace(**{n: getattr(self, n) + step}) for n, step in _STEP.items()]
        changes = np.column_stack([driven(car, tuple(commands)) - speeds for car in moved])
        deviations: Floats = np.sqrt(np.diag(covariance(changes / [*_STEP.values()])))
        return _SIGMAS * NOISE * deviations


@lru_cache(64)
def driven(car: Car, commands: tuple[float, ...]) -> Floats:
    """Return the speeds [m/s] at which a car from a standstill gets each command."""
    plant = Plant(road=Road.flat(), vehicle=car.vehicle, motor=Actuator(delay=car.delay))
    speeds = []
    for command in commands:
        speeds.append(plant.motion().v_x)
        plant.advance(Command(command, 0.0))
    return np.array(speeds)


LAW = replace(
    read_law(Path(__file__).with_name('identify.txt')),
    functions={'rint': np.rint, 'floor': np.floor, 'ceil': np.ceil},
)
_TRUE = tuple(f'true_{name}' for name in Car._fields)
_HIDDEN = LAW.situations['estimate'][0]


def car_of(name: str) -> Car:
    """Return the car of the student of this name."""
    return _cars(_HIDDEN.inputs(name, 1))[0]


def _cars(inputs: Inputs) -> list[Car]:
    return [Car(*each) for each in zip(*(inputs[name].tolist() for name in _TRUE), strict=True)]


def measured(car: Car, commands: Sequence[float]) -> list[float]:
    """Return the measured speeds [m/s] of a drive."""
    noise = Random(str(car)).gauss  # noqa: S311 (a simulation, not a secret)
    return [float(v) + noise(0.0, NOISE) for v in driven(car, tuple(commands))]


@cache
def _usual() -> list[float]:
    """Return commands that show all: a coast-down, then a random sequence of two values."""
    draw = Random('commands').choice  # noqa: S311 (as above)
    commands = [2.0] * 350 + [0.0] * 1400
    while len(commands) < len(_T):
        commands += [draw((-1.9, 2.0))] * 15
    return commands[: len(_T)]


def _drives(inputs: Inputs) -> list[list[Any]]:
    """Return the times, speeds and commands of each car."""
    return [[_T, measured(car, _usual()), _usual()] for car in _cars(inputs)]


def _agree(got: Floats, right: Floats) -> bool:
    return bool(np.all(np.abs(got - right) <= _WRONG * np.abs(right)))


_RESULTS = tuple(name + kind for name in Car._fields for kind in ('', '_interval'))
FUNCTIONS = Functions(
    LAW,
    {'estimate': ' '.join(_TRUE)},
    {'estimate': _RESULTS},
    {name: f'estimate.{name}' for name in Car._fields},
    _CARS,
    _agree,
    _drives,
)


def shown(car: Car, commands: Sequence[float], found: Sequence[float]) -> Evidence:
    """Return a drive of the student's car: three parameters, each with its interval."""
    rows, possible = [], car.intervals(commands)
    for k, (name, unit) in enumerate(_UNITS.items()):
        true, value, interval = car[k], *found[2 * k : 2 * k + 2]
        inside = 'holds the truth' if abs(value - true) <= interval else 'does not hold it'
        own = f'{value:.4g} ± {interval:.2g}'
        rows.append((name, f'{true:.4g} {unit}', own, f'± {possible[k]:.2g}', inside))
    header = ('', 'true', 'your estimate', 'best possible', 'your interval')
    table = Table('your car, with your commands', header, rows)
    return Evidence(table, partial(_figure, car, commands, found))


def _figure(car: Car, commands: Sequence[float], found: Sequence[float], title: str = '') -> Figure:
    """Draw the speed, what the estimated car predicts, and the residuals."""
    from barc_sim.figures.identification_figure import identification_figure  # noqa: PLC0415 (slow)

    predicted = driven(Car(*(min(max(each, 0.0), 0.4) for each in found[::2])), tuple(commands))
    speeds = np.array(_T), np.array(measured(car, commands)), predicted
    return identification_figure({'v_x': speeds}, title=title)


def _judge(code: JudgedCode, settings: Settings, _: Collection[str]) -> Iterator[Finding]:
    """Yield a finding for each criterion; the cars are those of the seed and the name."""
    car, commands, fault = car_of(''), _usual(), ''
    try:
        car = car_of(str(code.call('name')))
        commands = _commands(code)
        yield Finding('commands.limits', *_judge_limits(car, commands))
        yield from _judge_information(car, commands)
    except UserError as error:
        fault = str(error)
        yield from (Finding(each, 0.0, fault) for each in LABELS if each.startswith('commands'))
    findings, (trial, *_rest) = FUNCTIONS.judge(code, f'{settings.seed} {car}')
    yield from findings
    fault = trial.failure or fault
    score, text = (0.0, trial.failure) if trial.failure else _judge_intervals(trial)
    yield Finding('estimate.intervals', score, text)
    text, drive = f'the plot of the residuals, and two sentences: {BY_EYE}', None
    if not fault:
        try:
            found = code.rows('estimate', [[_T, measured(car, commands), commands]], len(_RESULTS))
            drive = shown(car, commands, found[0])
        except UserError as error:
            text = f'{text} ({error})'
    yield Finding('estimate.residuals', 0.0, text, drive, open=True)


def _commands(code: JudgedCode) -> list[float]:
    """Return the commands [m/s²] of 60 s; a UserError if no car can drive with them."""
    commands = numbers_of('command', code.call('functions', 'command', [[t] for t in _T]), len(_T))
    if (size := max(map(abs, commands))) > _NOT_A_CAR:
        raise UserError(f'command returned {size:.3g} m/s²: beyond {_NOT_A_CAR:g} it is not a car')
    return commands


def _judge_limits(car: Car, commands: Sequence[float]) -> tuple[float, str]:
    """Judge the size of the commands, and the speeds to which they lead."""
    speeds, size = driven(car, tuple(commands)), max(map(abs, commands))
    slow, fast = float(speeds.min()), float(speeds.max())
    faults = []
    if size > _MAX_COMMAND + 1e-9:
        first = int(np.argmax(np.abs(commands) > _MAX_COMMAND + 1e-9))
        force = ': is it a force? Return an acceleration' if size > _FORCE else ''
        faults.append(
            f'the command reaches {size:.3g} m/s², {_MAX_COMMAND:g} m/s² are allowed; '
            f'the first is at {_T[first]:.2f} s{force}'
        )
    if fast > _MAX_SPEED:
        faults.append(f'the car reaches {fast:.1f} m/s, {_MAX_SPEED:g} m/s are allowed')
    if slow < -0.05:  # noqa: PLR2004
        faults.append(f'the car drives backwards, at up to {-slow:.1f} m/s')
    if not speeds.any():
        faults.append('the car does not move')
    text = '; '.join(faults) or f'at most {size:.3g} m/s², and {fast:.1f} m/s'
    return max(1.0 - 0.5 * len(faults), 0.0), text


def _judge_information(car: Car, commands: Sequence[float]) -> Iterator[Finding]:
    """Judge what the commands show: the smallest interval that an estimate from them can have."""
    possible = car.intervals(np.clip(commands, -_MAX_COMMAND, _MAX_COMMAND).tolist())
    for (name, (full, zero)), best in zip(_SHOWN.items(), possible.tolist(), strict=True):
        score = share(best, full, zero)
        how = f'at best ± {best:.2g} {_UNITS[name]}' if best < np.inf else 'not at all'
        text = f'your commands show the {name} {how} (± {full:g} is full marks)'
        advice = f'; {_ADVICE[name]}' if score < 1.0 else ''
        yield Finding(f'commands.{name}', score, text + advice)


@np.errstate(all='ignore')  # of numbers of any size
def _judge_intervals(trial: Trial) -> tuple[float, str]:
    """Judge whether the intervals hold the truth, and are no wider than need be."""
    best = np.array([car.intervals(_usual()) for car in _cars(trial.inputs)])
    errors = [trial.got[name] - trial.inputs[f'true_{name}'] for name in Car._fields]
    widths = np.column_stack([trial.got[f'{name}_interval'] for name in Car._fields])
    inside = float(np.mean(np.abs(np.column_stack(errors)) <= widths))
    width, (low, high) = float(np.median(widths / best)), _WIDTH
    score = min(inside / _FULL_SHARE, 1.0) * (min(high / width, 1.0) if width > 0.0 else 0.0)
    text = f'{inside:.0%} of the intervals hold the truth; they are {width:.2g} times the smallest '
    text += 'that is possible'
    if np.any(widths < 0.0):
        text += '; an interval is below 0: return how far the truth may be off either way'
    elif _ONE_SIGMA[0] < width < _ONE_SIGMA[1]:
        score = min(score, 0.6)
        text += f'; is it one standard deviation? {_SIGMAS:g} of them hold 95 %'
    elif not low <= width <= high:
        text += '; too narrow: is it a variance?' if width < low else '; too wide'
    return score, text


IDENTIFY = Lab(
    files.IDENTIFY,
    JudgedCode,
    {'identify': Part(LABELS, _judge)},
    by_eye=frozenset({'estimate.residuals'}),
)
