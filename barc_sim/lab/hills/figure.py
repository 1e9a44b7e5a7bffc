"""The figure of `check`: a user's run beside barc_sim's, and the error of the user's model."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib import style
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from barc_sim.figures.run_figures import draw_error
from barc_sim.figures.style import BLUE, DASHES, EARTH, GREEN, INK, MUTED, STYLE, VERMILLION, limits
from barc_sim.simulation.metrics import RUN_UP

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from barc_sim.lab.hills.loop import Comparison
    from barc_sim.lab.hills.model import Trajectory

WIDTH = 9.6  #: [inch]
_RUN, _MODEL = 6.4, 2.6  #: [inch] heights of the two parts
_THRESHOLD = 1e-4  #: Below, the errors' axis is linear.
_MAX_SPEED = 40.0  #: [m/s] The speed axis ends there.
_REFERENCE: dict[str, Any] = {'color': INK, 'lw': 1.2, 'ls': DASHES}


@style.context(STYLE)
def check_figure(
    comparison: Comparison | None,
    trajectory: Trajectory | None,
    *,
    title: str = '',
    settings: str = '',
) -> Figure:
    """Draw the closed loop over the road, and the model's error over time.

    Parameters
    ----------
    comparison, trajectory
        Either can be None.
    title, settings
        The heading's two lines.

    Raises
    ------
    ValueError
        if both are None.
    """
    heights = [4.0, 1.6, 1.2, 2.0] if comparison else []
    heights += [2.2] if trajectory else []
    if not heights:
        raise ValueError('there is no run and no trajectory to draw')
    size = (WIDTH, _RUN * bool(comparison) + _MODEL * bool(trajectory))
    figure = Figure(figsize=size)
    figure.set_layout_engine('constrained', w_pad=0.08, h_pad=0.08)
    axes = np.atleast_1d(figure.subplots(len(heights), 1, height_ratios=heights))
    if comparison:
        _draw_run(comparison, *axes[:4])
    if trajectory:
        _draw_model(axes[-1], trajectory)
    # The legend is above the axes, then the heading's second line, then the title.
    axes[0].set_title(title, loc='left', pad=44.0, fontsize=14, fontweight='bold')
    axes[0].annotate(
        settings, (0.0, 1.0), (0.0, 27.0), 'axes fraction', 'offset points', color=MUTED
    )
    figure.align_ylabels()
    return figure


def _draw_run(comparison: Comparison, speed: Axes, error: Axes, grade: Axes, command: Axes) -> None:
    own, reference = comparison.user, comparison.reference
    speed.plot(reference.distance, reference.speed, zorder=3, **_REFERENCE)
    speed.plot(own.distance, own.speed, color=BLUE, lw=2.0)
    low, high = limits(np.clip(own.speed, -_MAX_SPEED, _MAX_SPEED), share=0.06, minimum=0.5)
    speed.set_ylim(low, max(high, 1.06 * float(reference.speed.max())))
    speed.set_ylabel('Speed [m/s]')
    draw_error(error, reference, **_REFERENCE)
    draw_error(error, own, color=BLUE, lw=1.6)
    grade.fill_between(reference.distance, reference.theta_deg, step='post', color=EARTH)
    grade.step(reference.distance, reference.theta_deg, where='post', color=MUTED, lw=1.2)
    grade.set_ylim(*limits(reference.theta_deg, share=0.15, minimum=5.0))
    grade.set_ylabel('Grade [°]')
    command.step(own.distance, own.motor, where='post', color=BLUE, lw=1.6, label='your PID')
    command.step(
        reference.distance, reference.motor, where='post', label="barc_sim's PID", **_REFERENCE
    )
    # The commands of the run-up can be so large that they would hide the rest.
    rest = [run.motor[run.distance >= RUN_UP] for run in (own, reference)]
    command.set_ylim(*limits(np.concatenate(rest), share=0.5, minimum=1.0))
    command.set_ylabel('Command [m/s²]')
    command.set_xlabel('Position along the road [m]')
    for axes in (speed, error, grade, command):
        axes.set_xlim(-1.0, float(reference.distance[-1]) + 1.0)
        axes.xaxis.set_major_locator(MaxNLocator(10, steps=[1, 2, 5, 10]))
    for axes in (speed, error, grade):
        axes.tick_params(labelbottom=False)
    _legend(speed, command)


def _draw_model(axes: Axes, trajectory: Trajectory) -> None:
    error = trajectory.user - trajectory.reference
    for values, color, line, label in (
        (np.hypot(error[:, 0], error[:, 1]), BLUE, '-', 'position [m]'),
        (np.abs(np.degrees(error[:, 2])), VERMILLION, (0, (1.5, 1.5)), 'heading [°]'),
        (np.abs(error[:, 3]), GREEN, DASHES, 'speed [m/s]'),
    ):
        axes.plot(trajectory.t, values, color=color, ls=line, lw=1.6, label=label)
    axes.set_yscale('symlog', linthresh=_THRESHOLD, linscale=1.0)
    axes.yaxis.set_major_formatter('{x:g}')
    top = float(np.nanmax(np.abs(error), initial=1e-2))
    axes.set_ylim(-_THRESHOLD / 5.0, max(2.0 * top, 0.1))
    axes.set_xlim(0.0, float(trajectory.t[-1]))
    axes.set_ylabel('Error of your model')
    axes.set_xlabel('Time [s], under the same commands')
    _legend(axes, axes)


def _legend(axes: Axes, labelled: Axes) -> None:
    """Put the legend of the axes `labelled` above others, on the right."""
    handles, labels = labelled.get_legend_handles_labels()
    axes.legend(
        handles, labels, loc='lower right', bbox_to_anchor=(1.0, 1.0), ncols=3, borderaxespad=0.2
    )
