"""The one table of the parameters of the node `vehicle_simulator`, and the plant made of them.

A default stands in the record that it belongs to: `Vehicle`, `LateralParameters`. A new field of
such a record needs a row here, and nothing else: `plant` fills the records by name.
"""

from __future__ import annotations

from math import inf
from typing import TYPE_CHECKING, Any, NamedTuple

from barc_sim.vehicle.actuators import Actuator
from barc_sim.vehicle.bicycles import DYNAMICS, LateralParameters
from barc_sim.vehicle.bike_model import Vehicle, bikeFE
from barc_sim.vehicle.plant import Plant
from barc_sim.vehicle.road import Road
from barc_sim.vehicle.sensor import SIGNALS, NoiseLevels

if TYPE_CHECKING:
    from collections.abc import Mapping

    from barc_sim.vehicle.bike_model import Model


#: Simulated seconds per second; besides, 0 is as fast as commands arrive.
REALTIME_FACTORS = (0.001, 1000.0)


class Parameter(NamedTuple):
    """A parameter of a node; `between` bounds a number, ends included, and so keeps NaN out."""

    name: str
    default: float | str | bool
    description: str
    between: tuple[float, float] | None = None
    read_only: bool = False


def _of(
    record: Vehicle | LateralParameters, name: str, description: str, between: tuple[float, float]
) -> Parameter:
    """Return the parameter of a record's field."""
    return Parameter(name, getattr(record, name), description, between)


_VEHICLE = Vehicle()
_LATERAL = LateralParameters()
_NOISE = [
    Parameter(f'noise_{name}', 0.0, f'standard deviation of {signal}', (0.0, 1e3))
    for name, signal in SIGNALS.items()
]
_ACTUATORS = [
    Parameter(f'{name}_{part}', 0.0, f'{what}; 0: none', (0.0, maximum))
    for name, unit, limit in (('motor', 'm/s²', 'acceleration'), ('servo', 'rad', 'steering'))
    for part, what, maximum in (
        ('delay', f'time from a command to its effect on the {name} [s]', 10.0),
        ('lag', f'time constant of the {name} [s]', 100.0),
        ('rate_limit', f'maximum change of {limit} [{unit}/s]', 1e6),
        ('limit', f'maximum {limit} either way [{unit}]', 1e6),
    )
]
PARAMETERS = [
    _of(_VEHICLE, 'mass', 'm, the mass [kg]', (1.0, 1e6)),
    _of(_VEHICLE, 'air_drag_coeff', 'a_0, air drag [N s²/m²]', (0.0, 1e3)),
    _of(_VEHICLE, 'friction', 'F_f, rolling resistance [N]', (0.0, 1e6)),
    _of(_VEHICLE, 'l_f', 'centre of mass to front axle [m]', (0.01, 100.0)),
    _of(_VEHICLE, 'l_r', 'centre of mass to rear axle [m]', (0.01, 100.0)),
    _of(_VEHICLE, 'gravity', 'g [m/s²]', (0.0, 100.0)),
    Parameter('rate', 50.0, 'steps per second of simulated time [Hz]', (1.0, 1000.0)),
    Parameter('road', 'lab', "'lab', 'flat' or a CSV file with the columns start_m,grade_deg"),
    Parameter(
        'realtime_factor',
        1.0,
        'simulated seconds per second; 0: each step as soon as its command has arrived',
        (0.0, REALTIME_FACTORS[1]),
    ),
    Parameter(
        'clock',
        default=False,
        description='whether /clock has the simulated time where realtime_factor is 1, too',
    ),
    Parameter('wait_for_controller', True, 'whether time begins only when a node publishes ecu'),
    Parameter(
        'command_timeout',
        0.0,
        'where no command has arrived for so long [s, by the wall clock], the car brakes to a '
        'standstill, and commands are not due state by state until one bears a stamp; 0: never',
        (0.0, 3600.0),
    ),
    Parameter('timeout_braking', 8.0, 'deceleration after command_timeout [m/s²]', (0.0, 100.0)),
    Parameter('refuse_motor_above', 100.0, 'a command beyond is refused [m/s²]', (0.0, 1e6)),
    Parameter('refuse_servo_above', 1.5, 'a command beyond is refused [rad]', (0.0, 1.5)),
    Parameter('seed', 0, 'seed of the measurement noise', (0, 2**53)),
    *_NOISE,
    *_ACTUATORS,
    Parameter('integrator', 'euler', "'euler' (forward) or 'rk4' (Runge-Kutta)"),
    Parameter(
        'dynamics',
        'kinematic',
        'the bicycle: ' + ', '.join(f'{name!r} ({what})' for name, what in DYNAMICS.items()),
    ),
    _of(_LATERAL, 'yaw_inertia', 'I_z of the dynamic one [kg m²]', (1.0, 1e7)),
    _of(_LATERAL, 'front_stiffness', "C_f, front axle's tyres [N/rad]", (1.0, 1e8)),
    _of(_LATERAL, 'rear_stiffness', "C_r, rear axle's tyres [N/rad]", (1.0, 1e8)),
    _of(
        _LATERAL,
        'dynamic_above',
        'slower than this [m/s], and in reverse, the dynamic bicycle is the kinematic one',
        (0.1, 100.0),
    ),
]

#: Those that can be changed while the car drives: they take effect with the next step.
LIVE = frozenset(parameter.name for parameter in (*_NOISE, *_ACTUATORS))
NANOSECONDS = 1_000_000_000


def period_ns(values: Mapping[str, Any]) -> int:
    """Return the time between two states [ns]."""
    return round(NANOSECONDS / float(values['rate']))


def plant(values: Mapping[str, Any], model: Model = bikeFE, road: Road | None = None) -> Plant:
    """Return the plant at the start, stepped by `model`, on `road` or the one that `values` name.

    UserError: the road cannot be read, or the values contradict one another.
    """
    return Plant(
        road=road or Road.named(values['road']),
        vehicle=Vehicle(*(values[name] for name in Vehicle._fields)),
        ts=period_ns(values) / NANOSECONDS,
        noise=_noise(values),
        seed=values['seed'],
        model=model,
        motor=_actuator(values, 'motor'),
        servo=_actuator(values, 'servo'),
        integrator=values['integrator'],
        dynamics=values['dynamics'],
        lateral=LateralParameters(*(values[name] for name in LateralParameters._fields)),
    )


def retune(values: Mapping[str, Any], plant: Plant) -> None:
    """Give the plant the `LIVE` parameters of `values`; all else stays as it is."""
    plant.retune(_noise(values), _actuator(values, 'motor'), _actuator(values, 'servo'))


def _noise(values: Mapping[str, Any]) -> NoiseLevels:
    return NoiseLevels(*(values[f'noise_{name}'] for name in NoiseLevels._fields))


def _actuator(values: Mapping[str, Any], name: str) -> Actuator:
    return Actuator(
        delay=values[f'{name}_delay'],
        lag=values[f'{name}_lag'],
        rate=values[f'{name}_rate_limit'] or inf,
        limit=values[f'{name}_limit'] or inf,
    )
