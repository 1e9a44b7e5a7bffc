"""Every lab, with the names of all criteria; a rubric names those of one."""

from __future__ import annotations

from typing import TYPE_CHECKING

from barc_sim.lab.labs.hills import HILLS
from barc_sim.lab.labs.identify import IDENTIFY
from barc_sim.lab.labs.lane import LANE
from barc_sim.lab.labs.raceline import RACELINE

if TYPE_CHECKING:
    from collections.abc import Collection

    from barc_sim.lab.judge import Lab

LABS = (HILLS, LANE, RACELINE, IDENTIFY)
#: Every criterion, with its name for readers, in the order of a report.
LABELS = {name: label for lab in LABS for name, label in lab.labels.items()}


def lab_of(criteria: Collection[str]) -> Lab:
    """Return the lab of a rubric with these criteria; ValueError where they are of several."""
    found = [lab for lab in LABS if not lab.labels.keys().isdisjoint(criteria)]
    if len(found) > 1:
        first, second = (next(name for name in criteria if name in lab.labels) for lab in found[:2])
        raise ValueError(f'{first!r} and {second!r} are of two labs: keep the criteria of one')
    return found[0]
