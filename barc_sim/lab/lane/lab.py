"""Lab 3 as data: lane keeping. The errors beside a track, the steady turn, and a steering law."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from barc_sim.lab import handout
from barc_sim.lab.check.functions import Functions
from barc_sim.lab.check.lab import Lab, Part
from barc_sim.lab.check.laws import read
from barc_sim.lab.lane import drive
from barc_sim.vehicle.bike_model import L_F, L_R

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterator, Mapping

    from barc_sim.lab.check.code import Finding
    from barc_sim.lab.check.lab import Settings
    from barc_sim.lab.check.laws import Floats

LABELS = {
    'errors.straight_e_y': 'Errors: e_y beside a straight',
    'errors.straight_e_psi': 'Errors: e_psi beside a straight',
    'errors.arc_e_y': 'Errors: e_y beside an arc',
    'errors.arc_e_psi': 'Errors: e_psi beside an arc',
    'steady.delta': 'Steady turn: steering',
    'steady.e_psi': 'Steady turn: e_psi',
}


def _wrapped(angle: Floats) -> Floats:
    return np.arctan2(np.sin(angle), np.cos(angle))


_FORMULAS: Mapping[str, Callable[..., Floats]] = {
    'wrapped': _wrapped,
    'hypot': np.hypot,
    'sqrt': np.sqrt,
    'arcsin': np.arcsin,
}
LAW = replace(read(Path(__file__).with_name('lane.txt'), L_F=L_F, L_R=L_R), functions=_FORMULAS)
_RESULTS = {
    'straight_errors': ('straight_e_y', 'straight_e_psi'),
    'arc_errors': ('arc_e_y', 'arc_e_psi'),
    'steady': ('steady_delta', 'steady_e_psi'),
}
FUNCTIONS = Functions(
    LAW,
    {
        'straight_errors': 'x y psi x_0 y_0 psi_0',
        'arc_errors': 'x y psi x_c y_c radius',
        'steady': 'curvature',
    },
    _RESULTS,
    dict(zip((name for own in _RESULTS.values() for name in own), LABELS, strict=True)),
)


def _judge(
    code: drive.LaneCode, settings: Settings, criteria: Collection[str]
) -> Iterator[Finding]:
    yield from FUNCTIONS.judge(code, settings.seed)[0]
    if not drive.LABELS.keys().isdisjoint(criteria):
        yield from drive.judge_lane(code, settings, criteria)


LANE = Lab(
    handout.LANE,
    drive.LaneCode,
    {'lane': Part({**LABELS, **drive.LABELS}, _judge)},
    by_eye=frozenset({'lane.delay'}),
)
