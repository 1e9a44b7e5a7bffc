"""The figure of `barc identify`: each signal, its prediction, and the error."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib import style
from matplotlib.figure import Figure

from barc_sim.figures.style import BLUE, INK, STYLE, VERMILLION

if TYPE_CHECKING:
    from collections.abc import Mapping

    from barc_sim.simulation.log import Floats

#: By signal: its name and unit.
SIGNALS = {
    'v_x': ('Speed', 'm/s'),
    'psi_dot': ('Yaw rate', 'rad/s'),
    'v_y': ('Lateral speed', 'm/s'),
}


@style.context(STYLE)
def identification_figure(
    signals: Mapping[str, tuple[Floats, Floats, Floats]], *, title: str = ''
) -> Figure:
    """Draw signals by name as `Identified` has them, and the error below; logs follow in turn."""
    n = len(signals)
    figure = Figure(figsize=(9.0, 1.2 + 3.2 * n), layout='constrained')
    figure.suptitle(title)
    panels = figure.subplots(2 * n, 1, sharex=True, height_ratios=[3.0, 1.2] * n, squeeze=False)
    for (name, (t, measured, predicted)), (above, below) in zip(
        signals.items(), panels[:, 0].reshape(n, 2), strict=True
    ):
        # One log follows the other, without a line from the end of the first to the next.
        steps = np.diff(t, prepend=t[0])
        begins = steps < 0.0
        time = np.cumsum(np.where(begins, np.median(steps), steps))
        line = np.where(begins, np.nan, predicted)
        above.plot(time, measured, '.', ms=2.0, color=INK, alpha=0.5, label='measured')
        above.plot(time, line, lw=1.2, color=BLUE, label='predicted from the first state')
        label, unit = SIGNALS[name]
        above.set_ylabel(f'{label} [{unit}]')
        below.plot(time, predicted - measured, lw=0.6, color=VERMILLION)
        below.axhline(0.0, lw=0.8, color=INK)
        below.set_ylabel(f'Error [{unit}]')
    panels[0, 0].legend(loc='lower right', bbox_to_anchor=(1.0, 1.0), ncols=2, borderaxespad=0.2)
    panels[-1, 0].set_xlabel('Time [s]')
    return figure
