"""The plant that the parameters of the node `vehicle_simulator` make."""

from __future__ import annotations

from math import inf
from typing import TYPE_CHECKING, Any

from barc_sim.vehicle.actuators import Actuator
from barc_sim.vehicle.bike_model import Vehicle, bikeFE
from barc_sim.vehicle.plant import Plant
from barc_sim.vehicle.road import Road
from barc_sim.vehicle.sensor import Deviation
from barc_sim.vehicle.tyres import Handling

if TYPE_CHECKING:
    from collections.abc import Mapping

    from barc_sim.vehicle.bike_model import Model

NANOSECONDS = 1_000_000_000


def period_ns(values: Mapping[str, Any]) -> int:
    """Return the time between two states [ns]."""
    return round(NANOSECONDS / float(values['rate']))


def plant(values: Mapping[str, Any], model: Model = bikeFE, road: Road | None = None) -> Plant:
    """Return the plant at the start, stepped by `model`, on `road` or the one that `values` name.

    Raises
    ------
    UserError
        where the road can't be had, or what is asked for does not go together.
    """
    return Plant(
        road=road or Road.named(values['road']),
        vehicle=Vehicle(*(values[name] for name in Vehicle._fields)),
        ts=period_ns(values) / NANOSECONDS,
        noise=Deviation(*(values[f'noise_{name}'] for name in Deviation._fields)),
        seed=values['seed'],
        model=model,
        motor=_actuator(values, 'motor'),
        servo=_actuator(values, 'servo'),
        integrator=values['integrator'],
        dynamics=values['dynamics'],
        handling=Handling(*(values[name] for name in Handling._fields)),
    )


def _actuator(values: Mapping[str, Any], name: str) -> Actuator:
    return Actuator(
        delay=values[f'{name}_delay'],
        lag=values[f'{name}_lag'],
        rate=values[f'{name}_rate_limit'] or inf,
        limit=values[f'{name}_limit'] or inf,
    )
