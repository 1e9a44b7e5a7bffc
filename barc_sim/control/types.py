"""The controllers that a run can be given by name."""

from __future__ import annotations

from typing import TYPE_CHECKING

from barc_sim.control.lqr import LQR
from barc_sim.control.pid import PID

if TYPE_CHECKING:
    from collections.abc import Mapping

    from barc_sim.control.controller import Controller, Gain

#: By the name that `--controller-type` and the parameter `controller_type` take.
TYPES: Mapping[str, type[Controller]] = {
    'pid': PID,
    'lqr': LQR,
}
DEFAULT_TYPE = 'pid'
#: The gains of all of them, by name.
GAINS: Mapping[str, Gain] = {
    name: gain for controller in TYPES.values() for name, gain in controller.gains.items()
}
#: The terms of all of them, by name.
TERMS: Mapping[str, str] = {
    name: meaning for controller in TYPES.values() for name, meaning in controller.terms.items()
}
