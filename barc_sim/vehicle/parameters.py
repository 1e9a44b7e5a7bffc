"""The table of the parameters of the node `vehicle_simulator`, and the plant made from them.

A field of `Vehicle`, `LateralParameters` or `NoiseLevels` declares its parameter, default and
limits; a new one needs nothing here: `plant` fills the records by name.
"""

from __future__ import annotations

from math import inf
from typing import TYPE_CHECKING, Any

from barc_sim.errors import Parameter, parameters_of
from barc_sim.vehicle.bicycles import DYNAMICS, LateralParameters
from barc_sim.vehicle.bike_model import Vehicle, bikeFE
from barc_sim.vehicle.plant import Actuator, NoiseLevels, Plant
from barc_sim.vehicle.road import Road
from barc_sim.vehicle.track import TRACKS

if TYPE_CHECKING:
    from collections.abc import Mapping

    from barc_sim.vehicle.bike_model import Model
    from barc_sim.vehicle.track import Track


#: The steering on a track unless given: an ideal one jumps at each arc's end.
SERVO = Actuator(lag=0.1, rate=1.0)
TRACK = Parameter(
    'track',
    '',
    f'the track: {", ".join(map(repr, TRACKS))} or a CSV file with the columns length_m,radius_m; '
    'the road then gives the hills along it; empty: none',
    read_only=True,
)
#: Defaults on a track.
ON_TRACK = {'road': 'flat', 'servo_lag': SERVO.lag, 'servo_rate_limit': SERVO.rate}
#: Simulated seconds per second; besides, 0 is as fast as commands arrive.
REALTIME_FACTORS = (0.001, 1000.0)


_NOISE = [row._replace(name=f'noise_{row.name}') for row in parameters_of(NoiseLevels)]
_ACTUATORS = [
    row._replace(
        name=f'{name}_{row.name}_limit' if row.name == 'rate' else f'{name}_{row.name}',
        default=0.0,
        description=f'{name}: {row.description.replace("unit", unit)}; 0: none',
        between=(0.0, min(row.between[1], 1e6)),
    )
    for name, unit in (('motor', 'm/s²'), ('servo', 'rad'))
    for row in parameters_of(Actuator)
]
_FORCE = Parameter('disturbance', 0.0, 'force on the car, positive forwards [N]', (-1e6, 1e6))
PARAMETERS = [
    *parameters_of(Vehicle),
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
        description='whether to publish the simulated time on /clock even if realtime_factor is 1',
    ),
    Parameter('wait_for_controller', True, 'whether time begins only once a node publishes ecu'),
    Parameter(
        'command_timeout',
        0.0,
        'time without a command [s, wall clock] after which the car brakes; with it, states have '
        'no deadline until a command has a stamp; 0: never',
        (0.0, 3600.0),
    ),
    Parameter('timeout_braking', 8.0, 'deceleration after command_timeout [m/s²]', (0.0, 100.0)),
    Parameter('refuse_motor_above', 100.0, 'maximum accepted command [m/s²]', (0.0, 1e6)),
    Parameter('refuse_servo_above', 1.5, 'maximum accepted command [rad]', (0.0, 1.5)),
    Parameter('seed', 0, 'seed of the measurement noise', (0, 2**53)),
    *_NOISE,
    *_ACTUATORS,
    _FORCE,
    Parameter('integrator', 'euler', "'euler' (forward) or 'rk4' (Runge-Kutta)"),
    Parameter(
        'dynamics',
        'kinematic',
        'the bicycle: ' + ', '.join(f'{name!r} ({what})' for name, what in DYNAMICS.items()),
    ),
    *parameters_of(LateralParameters),
]
ROWS = {row.name: row for row in PARAMETERS}

#: Those that can be changed while the car drives: they take effect with the next step.
LIVE = frozenset(parameter.name for parameter in (*_NOISE, *_ACTUATORS, _FORCE))
NANOSECONDS = 1_000_000_000
FORCE_COLUMN = 'force_n'  #: of a file with a disturbance


def plant(
    values: Mapping[str, Any],
    model: Model = bikeFE,
    road: Road | None = None,
    track: Track | None = None,
) -> Plant:
    """Return the plant at the start, stepped by `model`, on `road` or the road in `values`.

    UserError: the road cannot be read, or the values contradict one another.
    """
    return Plant(
        road=road or Road.named(values['road']),
        vehicle=Vehicle(*(values[name] for name in Vehicle._fields)),
        ts=round(NANOSECONDS / float(values['rate'])) / NANOSECONDS,
        noise=_noise(values),
        seed=values['seed'],
        force=values['disturbance'],
        model=model,
        motor=_actuator(values, 'motor'),
        servo=_actuator(values, 'servo'),
        integrator=values['integrator'],
        dynamics=values['dynamics'],
        lateral=LateralParameters(*(values[name] for name in LateralParameters._fields)),
        track=track,
    )


def retune(values: Mapping[str, Any], plant: Plant) -> None:
    """Give the plant the `LIVE` parameters of `values`; waiting commands stay."""
    plant.sensor.noise = _noise(values)
    plant.force = values['disturbance']
    plant.actuators.replace(_actuator(values, 'motor'), _actuator(values, 'servo'))


def _noise(values: Mapping[str, Any]) -> NoiseLevels:
    return NoiseLevels(*(values[f'noise_{name}'] for name in NoiseLevels._fields))


def _actuator(values: Mapping[str, Any], name: str) -> Actuator:
    return Actuator(
        delay=values[f'{name}_delay'],
        lag=values[f'{name}_lag'],
        rate=values[f'{name}_rate_limit'] or inf,
        limit=values[f'{name}_limit'] or inf,
    )
