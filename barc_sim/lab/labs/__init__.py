"""Each lab: its right results, its common mistakes, and how both are judged.

A lab is a module with the name of its templates' folder. It has a `Lab` of this name in capitals,
such as `lane.LANE`. The process of a submission reads handouts, but may not import a law. So a
handout does not refer to its `Lab`; `lab_of` finds it by the name. `relay.py` is no lab: it judges
a part of the hills lab.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from barc_sim.lab.files import Handout
    from barc_sim.lab.judge import Lab


def lab_of(handout: Handout) -> Lab:
    """Return the lab that judges what a handout asks for."""
    module = import_module(f'{__name__}.{handout.folder}')
    lab: Lab = getattr(module, handout.folder.upper())
    return lab
