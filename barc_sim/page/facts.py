"""What the page shows of a run beside its states, from the parameters of the nodes."""

from __future__ import annotations

from dataclasses import asdict
from math import isfinite
from typing import TYPE_CHECKING, Any

import numpy as np

from barc_sim.control.pid import ACCELERATION_LIMIT, PID
from barc_sim.control.types import DEFAULT_TYPE, GAINS, TYPES
from barc_sim.errors import UserError
from barc_sim.figures.style import FORCES, QUANTITIES, term_colours
from barc_sim.page.protocol import CAR, COLUMNS, OTHERS, TUNABLE
from barc_sim.vehicle.bike_model import Vehicle
from barc_sim.vehicle.road import Road

if TYPE_CHECKING:
    from collections.abc import Mapping

    from barc_sim.control.controller import Controller, Gain
    from barc_sim.simulation.log import Log
    from barc_sim.simulation.metrics import Lap, Laps

_OF_RUN = ('road', 'distance', 'laps')
#: Parameters of `vehicle_simulator` that the page shows.
OF_SIMULATOR = ('l_f', 'l_r', 'mass', *_OF_RUN, *CAR)
#: Short names of the sliders, where they differ from the parameter's.
_SHORT = {
    'speed_reference': 'speed',
    'acceleration_limit': 'limit',
    'noise_v_x': 'noise',
    'motor_delay': 'delay',
    'motor_limit': 'limit',
}
#: The preset that shows windup: the motor's limit is below the controller's.
_WINDUP = {'kp': 4.0, 'ki': 8.0, 'kd': 0.0, 'acceleration_limit': 100.0, 'motor_limit': 6.0}


def facts(
    mode: str,
    simulator: Mapping[str, Any],
    controller: Mapping[str, Any],
    kind: type[Controller] = PID,
    road: Road | None = None,
) -> dict[str, Any]:
    """Return the fields of the greeting; unknown parameters are left out.

    `kind` declares the controller's gains, a slider each, and the terms to draw. `road` replaces
    the one that the simulator's parameter names.
    """
    sliders = {**kind.gains, **OTHERS, **CAR}
    values = {**simulator, **controller}
    return {
        'mode': mode,
        'columns': COLUMNS,
        'road': road_facts(road) if road else _road(simulator.get('road')),
        'axles': [-simulator.get('l_r', 1.5), simulator.get('l_f', 1.5)],
        'mass': simulator.get('mass', Vehicle().mass),
        'terms': list(kind.terms),
        'colours': QUANTITIES | term_colours((*kind.terms,)),
        'forces': FORCES,
        'sliders': {
            name: {
                'label': _label(name, gain),
                'short': _SHORT.get(name, name.replace('_', ' ')),
                'unit': '' if gain.unit == '-' else gain.unit,
                'max': gain.slider,
                'node': TUNABLE[name],
            }
            for name, gain in sliders.items()
        },
        'presets': _presets(kind),
        'controller_type': next(
            (name for name, type_ in TYPES.items() if type_ is kind), DEFAULT_TYPE
        ),
        'tuning': {name: values[name] for name in sliders if name in values},
        'run': {name: simulator[name] for name in _OF_RUN if name in simulator},
    }


def _presets(kind: type[Controller]) -> dict[str, dict[str, float]]:
    """Return the values of each preset; all but the windup have the usual limits."""
    limits = {'acceleration_limit': ACCELERATION_LIMIT, 'motor_limit': 0.0}
    presets = {name: {**gains, **limits} for name, gains in getattr(kind, 'presets', {}).items()}
    return presets | ({'Windup': _WINDUP} if presets else {})


def _label(name: str, gain: Gain) -> str:
    """Return a slider's label, as in `Proportional gain, kp [1/s]`."""
    unit = '' if gain.unit == '-' else f' [{gain.unit}]'
    symbol = f', {name}' if name in GAINS else ''
    return f'{gain.meaning.capitalize()}{symbol}{unit}'


def road_facts(road: Road) -> dict[str, list[float]]:
    """Return where stretches begin [m] and their grades [deg]."""
    return {'starts': list(road.starts), 'grades_deg': list(road.grades_deg)}


def driven_road(log: Log) -> Road | None:
    """Return the road as far as a run has seen it; None where it recorded none.

    A change of grade lies somewhere between two states: in the middle, then.
    """
    recorded = np.flatnonzero(np.isfinite(log.theta_deg) & np.isfinite(log.distance))
    if not recorded.size:
        return None
    distance, first = np.unique(log.distance[recorded], return_index=True)
    grade = log.theta_deg[recorded][first]
    change = np.flatnonzero(np.diff(grade))
    return Road(
        starts=(float(distance[0]), *((distance[change] + distance[change + 1]) / 2.0).tolist()),
        grades_deg=(float(grade[0]), *grade[change + 1].tolist()),
    )


def _road(name: str | None) -> dict[str, list[float]] | None:
    """Return the road, or None where it is unknown: the page then shows what was driven."""
    if name is None:
        return None
    try:
        return road_facts(Road.named(name))
    except UserError:  # a file that the simulator's process sees, and this one doesn't
        return None


def lap_facts(laps: Laps) -> dict[str, Any]:
    """Return the present lap, the one before, the best and the number of laps."""
    return {
        'count': laps.current.number + 1,
        'current': _lap(laps.current),
        'last': laps.last and _lap(laps.last),
        'best': (best := laps.best) and _lap(best),
    }


def stretch_facts(lap: Lap) -> list[dict[str, Any]]:
    """Return the table of a lap's stretches."""
    return [_finite(asdict(stretch)) for stretch in lap.summary.stretches]


def _lap(lap: Lap) -> dict[str, Any]:
    summary = lap.summary
    return _finite(
        {
            'number': lap.number,
            'start': lap.start,
            'end': lap.end,
            'rms': summary.rms_error_after_run_up,
            'maximum': summary.max_error_after_run_up,
            'overshoot': summary.overshoot,
            'settling': summary.settling_time,
        }
    )


def _finite(fields: dict[str, Any]) -> dict[str, Any]:
    """Return the fields with None for each number that is unknown."""
    return {name: value if isfinite(value) else None for name, value in fields.items()}
