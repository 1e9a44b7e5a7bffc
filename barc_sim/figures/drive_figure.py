"""The figure of a drive by hand: its path, and heading, speed and steering over time."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib import style
from matplotlib.figure import Figure

from barc_sim.figures.style import BLUE, GREEN, INK, STYLE, VERMILLION, limits, use_measurement

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from numpy.typing import NDArray

    from barc_sim.simulation.log import Log

SIZE = (9.6, 9.6)  #: [inch]
JUMP = 5.0  #: [m] From one state to the next; more than this is a reset to the start.


@style.context(STYLE)
def drive_figure(log: Log, *, title: str = '') -> Figure:
    """Draw the path from above, and heading, speed and steering over time.

    Where the car was put back to the start, the lines are broken.

    Examples
    --------
    >>> from barc_sim.control.driver import DriverInput
    >>> from barc_sim.simulation.closed_loop import drive_by_hand
    >>> log = drive_by_hand([(0.0, DriverInput(forward=1.0, turn=0.2))], duration=2.0)
    >>> drive_figure(log).savefig('drive.svg')
    """
    log = use_measurement(log)
    figure = Figure(figsize=SIZE, layout='constrained')
    path, heading, speed, steering = figure.subplots(4, 1, height_ratios=[4.0, 1.4, 1.4, 1.4])
    jumps = np.hypot(np.diff(log.distance), np.diff(log.across)) > JUMP
    _draw_path(path, *(_broken(values, jumps) for values in (log.distance, log.across)))
    degrees = np.degrees(np.unwrap(np.nan_to_num(log.psi - log.e_epsi)))
    for axes, values, color, label in (
        (heading, _broken(degrees, jumps), GREEN, 'Heading [°]'),
        (speed, _broken(log.speed, jumps), BLUE, 'Speed [m/s]'),
    ):
        axes.plot(log.t, values, color=color, lw=1.8)
        axes.set_ylim(*limits(values[~np.isnan(values)], share=0.1, least=1.0))
        axes.set_ylabel(label)
        axes.tick_params(labelbottom=False)
    servo = np.degrees(log.servo)
    steering.step(log.t, servo, where='post', color=VERMILLION, lw=1.6)
    steering.set_ylim(*limits(servo[~np.isnan(servo)], share=0.1, least=1.0))
    steering.set(ylabel='Steering [°]', xlabel='Time [s]; left is positive')
    for axes in (heading, speed, steering):
        axes.set_xlim(*limits(log.t, share=0.01, least=1.0))
    path.set_title(title, loc='left', fontsize=14, fontweight='bold')
    figure.align_ylabels([heading, speed, steering])
    return figure


def _broken(values: NDArray[np.float64], jumps: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Return `values` with NaN before each jump."""
    return np.where(np.append(jumps, False), np.nan, values)


def _draw_path(axes: Axes, x: NDArray[np.float64], y: NDArray[np.float64]) -> None:
    axes.plot(x, y, color=BLUE, lw=1.8)
    axes.plot(x[:1], y[:1], 'o', color=INK, label='start')
    axes.plot(x[-1:], y[-1:], 's', color=VERMILLION, label='end')
    axes.set_aspect('equal', adjustable='datalim')
    axes.set(xlabel='x [m]', ylabel='y [m]')
    axes.legend(loc='lower right', bbox_to_anchor=(1.0, 1.0), ncols=2, borderaxespad=0.0)
