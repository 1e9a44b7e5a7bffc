"""The options of an environment: those fields of a `Scenario` that it has a part for.

They come by name, in a `Scenario`, or as the plain values that JSON has.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from typing import TYPE_CHECKING, Any

from barc_sim.cli.limits import not_between
from barc_sim.errors import UserError
from barc_sim.interfaces.parameters import parameters_of
from barc_sim.simulation.scenario import LIMITS, Scenario
from barc_sim.vehicle.bicycles import LateralParameters
from barc_sim.vehicle.bike_model import Vehicle
from barc_sim.vehicle.plant import Actuator, NoiseLevels
from barc_sim.vehicle.road import Profile, Road
from barc_sim.vehicle.track import Track

if TYPE_CHECKING:
    from gymnasium.envs.registration import EnvSpec

#: The fields of a `Scenario` that are options of an environment.
OPTIONS = (
    'road',
    'track',
    'vehicle',
    'dynamics',
    'lateral',
    'integrator',
    'delay',
    'motor',
    'servo',
    'noise',
    'sensor_delay',
    'disturbance',
    'ts',
)
#: Further fields that a scenario may have: the speed, its limit, and ends, which end no episode.
OF_RUN = ('speed_reference', 'acceleration_limit', 'distance', 'laps', 'max_duration')
#: What `ranges` may have, and its limits.
VARIED = {
    row.name: row.between
    for row in (
        *parameters_of(Vehicle),
        *parameters_of(LateralParameters),
        LIMITS['noise'],
        LIMITS['delay'],
        LIMITS['disturbance'],
    )
}
#: The options that are records, by name, which JSON has as lists of numbers.
_RECORDS: Mapping[str, type[Any]] = {
    'vehicle': Vehicle,
    'lateral': LateralParameters,
    'motor': Actuator,
    'servo': Actuator,
    'noise': NoiseLevels,
}
#: The options that are dataclasses, by name, which JSON has as objects.
_DATACLASSES: Mapping[str, type[Any]] = {'road': Road, 'track': Track, 'disturbance': Profile}


def checked_numbers(
    argument: str,
    values: Any,  # noqa: ANN401 (a user's)
    limits: Mapping[str, tuple[float, float]],
) -> dict[str, float]:
    """Return a new dict of numbers by name; UserError: it is none, or one is beyond its limits."""
    numbers = _checked_names(argument, values, limits)
    for name, number in numbers.items():
        _check_number(argument, name, number, limits[name])
    return numbers


def checked_ranges(ranges: Any) -> dict[str, tuple[float, float]]:  # noqa: ANN401 (a user's)
    """Return a new dict of pairs by name; UserError: it is none, or one is beyond its limits."""
    pairs = _checked_names('ranges', ranges, VARIED)
    for name, pair in pairs.items():
        try:
            lowest, highest = pair
        except (TypeError, ValueError):
            raise UserError(
                f'ranges: {name}: {pair!r} is not a pair of numbers: give (lowest, highest)'
            ) from None

        _check_number('ranges', name, lowest, VARIED[name])
        _check_number('ranges', name, highest, VARIED[name])
    return pairs


def _checked_names(
    argument: str,
    values: Any,  # noqa: ANN401 (a user's)
    limits: Mapping[str, tuple[float, float]],
) -> dict[str, Any]:
    try:
        by_name = {} if values is None else dict(values)
    except (TypeError, ValueError):
        raise UserError(
            f'{argument}: {values!r} is not a dict: give each value by its name'
        ) from None

    for name in by_name:
        if name not in limits:
            raise UserError(f'{argument}: {name!r} must be one of {", ".join(limits)}')
    return by_name


def _check_number(argument: str, name: str, number: object, limits: tuple[float, float]) -> None:
    reason = not_between(number, *limits)
    if reason:
        raise UserError(f'{argument}: {name}: {reason}')


def scenario_of(scenario: Any) -> Any:  # noqa: ANN401 (a user's)
    """Return the scenario of the plain values that JSON has; anything else is returned as it is.

    UserError: it has no such field, or a value is beyond its limits.
    """
    if not isinstance(scenario, Mapping):
        return scenario

    names = [field.name for field in fields(Scenario)]
    for name in scenario:
        if name not in names:
            raise UserError(f'scenario: {name!r} must be one of {", ".join(names)}')

    return Scenario(**{name: option_of(name, value) for name, value in scenario.items()})


def option_of(name: str, value: Any) -> Any:  # noqa: ANN401 (of any option)
    """Return an option's value; the JSON of an environment's specification has lists and dicts.

    UserError: a value of a record is out of its limits.
    """
    if name in _RECORDS and isinstance(value, list):
        record = _RECORDS[name]
        if len(value) != len(record._fields):
            raise UserError(
                f'{name} {value!r} has {len(value)} numbers: expected {", ".join(record._fields)}'
            )
        return record(*value)

    if name in _DATACLASSES and isinstance(value, dict):
        return _dataclass_of(name, value)
    return value


def _dataclass_of(name: str, values: dict[str, Any]) -> Any:  # noqa: ANN401 (as above)
    kind = _DATACLASSES[name]
    names = [field.name for field in fields(kind) if field.init]
    if not set(names) <= values.keys():
        raise UserError(f'{name} {values!r} must have {", ".join(names)}')
    return kind(**{each: _tuple_of(values[each]) for each in names})


def _tuple_of(value: object) -> object:
    """Return a tuple of a list, which stands for it in JSON."""
    return tuple(value) if isinstance(value, list) else value


def with_plain_scenario(spec: EnvSpec | None) -> EnvSpec | None:
    """Return a specification whose scenario is a dict of its fields, which JSON can carry."""
    if spec is None or not isinstance(spec.kwargs.get('scenario'), Scenario):
        return spec
    spec.kwargs = {**spec.kwargs, 'scenario': spec.kwargs['scenario'].changes()}
    return spec
