"""What a plant is made from: one record, and the parameters of the node that derive from it.

A field of `PlantOptions`, `Vehicle`, `LateralParameters`, `NoiseLevels` or `Actuator` declares its
meaning, default and limits. A new field of `Vehicle`, say, needs nothing here: the node has the
parameter of that name, and `PlantOptions.of_parameters` fills the records by name.
"""

from __future__ import annotations

import inspect
from dataclasses import dataclass, fields
from functools import cache
from math import inf
from os import PathLike
from typing import TYPE_CHECKING, Annotated, Any

from barc_sim.errors import UserError
from barc_sim.interfaces.parameters import UNBOUNDED, ParameterDeclaration, parameters_of
from barc_sim.interfaces.stamps import NANOSECONDS
from barc_sim.vehicle.bicycles import DYNAMICS, LateralParameters
from barc_sim.vehicle.bike_model import BicycleState, Model, Vehicle, bikeFE
from barc_sim.vehicle.plant import Actuator, NoiseLevels, Plant
from barc_sim.vehicle.road import Profile, Road, Signal, signal
from barc_sim.vehicle.track import TRACKS, Track

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from typing_extensions import Self


#: The steering on a track unless given: an ideal one jumps at each arc's end.
SERVO = Actuator(lag=0.1, rate=1.0)
FORCE_COLUMN = 'force_n'  #: of a file with a disturbance
_DELAY = next(each for each in parameters_of(Actuator) if each.name == 'delay')
_NOISE_V_X = next(each for each in parameters_of(NoiseLevels) if each.name == 'v_x')
_Path = str | PathLike[str]


@dataclass(frozen=True, kw_only=True, repr=False)
class PlantOptions:
    """What a plant is made from: course, car, actuators, sensor, disturbance and step.

    A field that is None has the default of the course or of its type. Names and files are read
    once: then the field is a `Road`, a `Track` or a `Profile`.

    Raises
    ------
    UserError
        if a field is out of its limits, a file cannot be read, or a field needs another. Names of
        laws, and how they go together with the step, are checked by `plant`.
    """

    road: Annotated[
        Road | _Path | None, "'lab', 'flat' or a CSV file with the columns start_m,grade_deg"
    ] = None
    track: Annotated[
        Track | _Path | None,
        f'the track: {", ".join(map(repr, TRACKS))} or a CSV file with the columns '
        'length_m,radius_m; the road then gives the hills along it; empty: none',
    ] = None
    e_y: Annotated[float, 'start of the car, to the left [m]', -1e3, 1e3] = 0.0
    vehicle: Vehicle | None = None
    dynamics: Annotated[
        str, 'the bicycle: ' + ', '.join(f'{name!r} ({text})' for name, text in DYNAMICS.items())
    ] = 'kinematic'
    lateral: LateralParameters | None = None
    integrator: Annotated[str, "'euler' (forward) or 'rk4' (Runge-Kutta)"] = 'euler'
    model: Model = bikeFE
    delay: Annotated[float, _DELAY] = 0.0
    motor: Actuator | None = None
    servo: Actuator | None = None
    noise: Annotated[float | NoiseLevels, _NOISE_V_X] = 0.0
    seed: Annotated[int, 'seed of the measurement noise', 0, 2**53] = 0
    sensor_delay: Annotated[float, 'age of a measurement at its stamp [s]', 0.0, 10.0] = 0.0
    disturbance: Annotated[
        float | _Path | Signal, 'force on the car, positive forwards [N]', -1e6, 1e6
    ] = 0.0
    ts: Annotated[float, 'step [s]', 0.001, 1.0] = 0.02

    def __post_init__(self) -> None:
        """Check the fields, and read the files that they name."""
        record: Any = type(self)
        for row in _limits(record):
            if row.name not in {'noise', 'disturbance'}:
                row.check(getattr(self, row.name))
        if not isinstance(self.noise, NoiseLevels):  # which has checked itself
            _OPTIONS['noise'].check(self.noise)
        for name, kind in _RECORDS.items():
            _check_kind(name, getattr(self, name), kind)

        force = signal(self.disturbance, _OPTIONS['disturbance'], FORCE_COLUMN)
        if isinstance(force, Profile):
            self._set('disturbance', force)
        if self.road is not None:
            self._set('road', Road.of(self.road))
        self._set('track', Track.of(self.track) if self.track else None)

        if self.e_y and not self.track:
            raise needs_track(f'e_y={self.e_y:g}')
        if self.motor and self.delay:
            raise UserError(
                f'delay={self.delay:g} and motor={self.motor!r} contradict each other: give the '
                'delay of the motor in motor'
            )

    def _set(self, name: str, value: object) -> None:
        """Set a field to what was read."""
        object.__setattr__(self, name, value)

    @classmethod
    def of_parameters(
        cls,
        values: Mapping[str, Any],
        **others: Any,  # noqa: ANN401 (of any field)
    ) -> Self:
        """Return the options in the `values` of a node's `PARAMETERS`, and the `others`."""
        options = {each.name: values[each.name] for each in fields(cls) if each.name in values}
        lateral = {name: values[name] for name in LateralParameters._fields}
        noise = {name: values[f'noise_{name}'] for name in NoiseLevels._fields}
        options |= {
            'vehicle': Vehicle(**{name: values[name] for name in Vehicle._fields}),
            'lateral': LateralParameters(**lateral),
            'noise': NoiseLevels(**noise),
            'motor': _actuator(values, 'motor'),
            'servo': _actuator(values, 'servo'),
            'ts': round(NANOSECONDS / float(values['rate'])) / NANOSECONDS,
        }
        return cls(**(options | others))

    def changes(self) -> dict[str, Any]:
        """Return the fields that differ from their defaults, by name."""
        changed = [each.name for each in fields(self) if getattr(self, each.name) != each.default]
        return {name: getattr(self, name) for name in changed}

    def __repr__(self) -> str:
        """Return the call that makes it, without the defaults."""
        arguments = [f'{name}={_shown(value)}' for name, value in self.changes().items()]
        return f'{type(self).__name__}({", ".join(arguments)})'

    def plant(self) -> Plant:
        """Return a plant at the start; UserError: fields contradict one another."""
        force, disturbance = self._forces()
        motor, servo = self._actuators()

        # `__post_init__` has read road and track: `of` returns them as they are, and is here for
        # the type checker.
        plant = Plant(
            road=None if self.road is None else Road.of(self.road),
            vehicle=self.vehicle,
            ts=round(self.ts * NANOSECONDS) / NANOSECONDS,
            noise=self._noise(),
            seed=self.seed,
            sensor_delay=self.sensor_delay,
            force=force,
            disturbance=disturbance,
            model=_with_options(self.model),
            motor=motor,
            servo=servo,
            integrator=self.integrator,
            dynamics=self.dynamics,
            lateral=self.lateral,
            track=Track.of(self.track) if self.track else None,
        )

        if plant.track and self.e_y:
            pose = plant.track.place(0.0, self.e_y)
            plant.place(BicycleState(pose.x, pose.y, pose.psi))
        return plant

    def retune(self, plant: Plant) -> None:
        """Give a plant what `LIVE` names; waiting commands and motions to be measured stay."""
        plant.sensor.noise = self._noise()
        plant.sensor.delay = self.sensor_delay
        plant.force, plant.disturbance = self._forces()
        motor, servo = self._actuators()
        plant.replace_actuators(motor, servo)

    def _noise(self) -> NoiseLevels:
        return self.noise if isinstance(self.noise, NoiseLevels) else NoiseLevels(v_x=self.noise)

    def _actuators(self) -> tuple[Actuator, Actuator]:
        """Return motor and servo."""
        motor = self.motor
        if motor is None:
            motor = Actuator(delay=self.delay)
        servo = self.servo
        if servo is None:
            servo = SERVO._replace(delay=self.delay) if self.track else Actuator()
        return motor, servo

    def _forces(self) -> tuple[float, Signal | None]:
        """Return the constant part of the disturbance [N], and the part that changes."""
        if isinstance(self.disturbance, (float, int)):
            return float(self.disturbance), None
        return 0.0, signal(self.disturbance, _OPTIONS['disturbance'], FORCE_COLUMN)


def _shown(value: object) -> str:
    """Return the representation of a value: of a course that has a name, its name."""
    if isinstance(value, Road) and value.name in ('lab', 'flat'):
        is_named = value == Road.named(value.name)
    elif isinstance(value, Track) and value.name in TRACKS:
        is_named = value == Track.named(value.name)
    else:
        return repr(value)
    return repr(value.name) if is_named else repr(value)


#: The fields that are records.
_RECORDS = {
    'vehicle': Vehicle,
    'lateral': LateralParameters,
    'motor': Actuator,
    'servo': Actuator,
}


def _check_kind(name: str, value: object, kind: Any) -> None:  # noqa: ANN401 (a class)
    """Raise UserError unless `value` is None, or a record of this kind within its limits."""
    if value is None:
        return
    if not isinstance(value, kind):
        field = kind._fields[0]
        example = f'{kind.__name__}({field}={kind._field_defaults[field]})'
        raise UserError(f'{name} {value!r} must be of type {kind.__name__}, such as {example}')
    for row in _limits(kind):  # `_replace` has not checked it
        row.check(getattr(value, row.name))


def needs_track(argument: str) -> UserError:
    """Return the error that an argument needs a track."""
    return UserError(f"{argument} needs a track: give one, such as track='L'")


@cache
def _limits(record: Any) -> list[ParameterDeclaration]:  # noqa: ANN401 (a class)
    """Return a parameter for each field of a record that has limits."""
    return [row for row in parameters_of(record) if row.between != UNBOUNDED]


def _with_options(model: Model) -> Model:
    """Return a model that drops the arguments `l_f`, `l_r` and `g` which `model` does not take."""
    if model is bikeFE:
        return model
    parameters = inspect.signature(model).parameters.values()
    if any(each.kind is inspect.Parameter.VAR_KEYWORD for each in parameters):
        return model
    names = {each.name for each in parameters}

    def adapted(*state_and_input: float, **options: float) -> Sequence[float]:
        accepted = {name: value for name, value in options.items() if name in names}
        return model(*state_and_input, **accepted)

    return adapted


_OPTIONS = {row.name: row for row in parameters_of(PlantOptions)}
TRACK = _OPTIONS['track']._replace(default='', read_only=True)
#: Defaults on a track.
ON_TRACK = {'road': 'flat', 'servo_lag': SERVO.lag, 'servo_rate_limit': SERVO.rate}

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
_SHORTEST, _LONGEST = _OPTIONS['ts'].between
_RATE = ParameterDeclaration(
    'rate',
    1.0 / PlantOptions.ts,
    'steps per second of simulated time [Hz]',
    (1.0 / _LONGEST, 1.0 / _SHORTEST),
)
PARAMETERS = [
    *parameters_of(Vehicle),
    _RATE,
    _OPTIONS['road']._replace(default='lab'),
    _OPTIONS['seed'],
    *_NOISE,
    _OPTIONS['sensor_delay'],
    *_ACTUATORS,
    _OPTIONS['disturbance'],
    _OPTIONS['integrator'],
    _OPTIONS['dynamics'],
    *parameters_of(LateralParameters),
]
ROWS = {row.name: row for row in PARAMETERS}

#: Those that can be changed while the car drives: `PlantOptions.retune` gives them to the plant.
LIVE = frozenset(
    row.name for row in (*_NOISE, _OPTIONS['sensor_delay'], *_ACTUATORS, _OPTIONS['disturbance'])
)


def _actuator(values: Mapping[str, Any], name: str) -> Actuator:
    return Actuator(
        delay=values[f'{name}_delay'],
        lag=values[f'{name}_lag'],
        rate=values[f'{name}_rate_limit'] or inf,
        limit=values[f'{name}_limit'] or inf,
    )
