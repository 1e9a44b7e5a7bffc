"""Lab 3 as data: lane keeping, and its criteria."""

from __future__ import annotations

from typing import TYPE_CHECKING

from barc_sim.lab import handout
from barc_sim.lab.check.lab import Lab, Part
from barc_sim.lab.lane import drive, functions

if TYPE_CHECKING:
    from collections.abc import Collection, Iterator

    from barc_sim.lab.check.code import Finding
    from barc_sim.lab.check.lab import Settings
    from barc_sim.lab.lane.functions import LaneCode


def _judge(code: LaneCode, settings: Settings, criteria: Collection[str]) -> Iterator[Finding]:
    yield from functions.judge_functions(code, settings.seed)
    if not drive.LABELS.keys().isdisjoint(criteria):
        yield from drive.judge_lane(code, settings, criteria)


LANE = Lab(
    handout.LANE,
    functions.LaneCode,
    {'lane': Part({**functions.LABELS, **drive.LABELS}, _judge)},
    by_eye=frozenset({'lane.delay'}),
)
