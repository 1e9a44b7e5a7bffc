"""How runs are shown, whatever the figure: colours, lines, limits of axes, readings."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from barc_sim.simulation.log import Log

# Okabe and Ito's palette, which the colour-blind tell apart, and greys.
BLUE = '#0072B2'
SKY = '#56B4E9'
VERMILLION = '#D55E00'
GREEN = '#009E73'
INK = '#222222'
MUTED = '#6B6B6B'
GREY = '#9A9A9A'
EARTH = '#E4E1DA'
SURFACE = '#7D776A'

#: Whatever a user's matplotlibrc says, the figures look the same.
LOOK: list[str | dict[str, Any]] = [
    'default',
    {
        'font.size': 10,
        'text.parse_math': False,  # a dollar in the name of a bag is a dollar
        'text.color': INK,
        'axes.edgecolor': GREY,
        'axes.labelcolor': INK,
        'axes.spines.top': False,
        'axes.spines.right': False,
        'axes.axisbelow': True,
        'axes.grid': True,
        'grid.color': '#E9E9E9',
        'xtick.color': GREY,
        'ytick.color': GREY,
        'xtick.major.size': 3,
        'ytick.major.size': 3,
        'xtick.labelcolor': INK,
        'ytick.labelcolor': INK,
        'lines.solid_capstyle': 'round',
        'legend.frameon': False,
    },
]

DASHES = (0.0, (5.0, 3.0))


def as_known(log: Log) -> Log:
    """Return the log with the measurement for the truth where the measurement's error is unknown.

    So it is at the end of a bag whose run was killed, and in one of a simulator that tells none.
    """
    errors = ('e_s', 'e_ey', 'e_epsi', 'e_v_x')
    return replace(log, **{name: np.nan_to_num(getattr(log, name)) for name in errors})


def limits(values: NDArray[np.float64], *, share: float, least: float) -> tuple[float, float]:
    """Return limits around `values` and zero, `share` wider, reaching `least` beyond at least."""
    known = values[np.isfinite(values)]
    low, high = min(known.min(initial=0.0), 0.0), max(known.max(initial=0.0), 0.0)
    pad = max(share * (high - low), least - max(high, -low))
    return low - pad, high + pad


def reading(value: float, digits: int, unit: str) -> str:
    """Return `value` with its unit as an instrument shows it, a dash for NaN."""
    if np.isnan(value):
        return '\N{EN DASH}'
    # Adding zero turns a negative zero into zero.
    return f'{round(value, digits) + 0.0:.{digits}f}{unit}'.replace('-', '\N{MINUS SIGN}')
