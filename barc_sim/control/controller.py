"""What a speed controller is: named gains, named terms, and a command for a measured speed."""

from __future__ import annotations

from math import nan
from typing import TYPE_CHECKING, NamedTuple, Protocol

from barc_sim.vehicle.limits import Parameter

if TYPE_CHECKING:
    from collections.abc import Mapping


class Gain(NamedTuple):
    """A number that tunes a controller."""

    default: float
    unit: str
    meaning: str
    slider: float  #: the page's slider goes from 0 to this value
    between: tuple[float, float] = (0.0, 1e6)  #: what is allowed, ends included


class Tunable(Protocol):
    """What declares its gains; each name is an attribute, too, and may be set at any time."""

    gains: Mapping[str, Gain]


class Controller(Protocol):
    """A speed controller, and the declaration of its gains and terms.

    Parameters of the node `controller`, `--gain`, the page's sliders, the log's columns, the
    messages in the bag and the plots follow from `gains` and `terms`. Each name in them is an
    attribute of the controller, too: a gain may be set at any time, a term is that of the latest
    call. `acc_calculate` keeps its output within `[output_min, output_max]`.
    """

    gains: Mapping[str, Gain]
    terms: Mapping[str, str]  #: [m/s²] parts of the output: their meaning by name
    output_min: float  #: [m/s²]
    output_max: float  #: [m/s²]
    saturated: bool  #: whether a limit cut the latest output

    def reset(self) -> None:
        """Forget the past: the next call is the first."""

    def acc_calculate(self, speed_reference: float, speed_current: float, dt: float, /) -> float:
        """Return the acceleration [m/s²] for speeds in m/s, `dt` seconds after the last call."""


def gain_parameters(controller: Tunable) -> list[Parameter]:
    """Return a parameter for each gain of a controller, with its present value as the default."""
    return [
        Parameter(
            name,
            float(getattr(controller, name)),
            f'{gain.meaning} [{gain.unit}]',
            gain.between,
        )
        for name, gain in controller.gains.items()
    ]


def read_term(controller: object, name: str) -> float:
    """Return an attribute of a controller; NaN where it has none, or no number."""
    try:
        return float(getattr(controller, name, nan))
    except (TypeError, ValueError):
        return nan


def check_gains(controller: Tunable) -> None:
    """Raise UserError where a gain is beyond its limits."""
    for name, gain in controller.gains.items():
        Parameter(name, gain.default, gain.meaning, gain.between).check(getattr(controller, name))
