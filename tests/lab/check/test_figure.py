"""The figure of a check: what it draws of a user's run and model."""

from __future__ import annotations

from math import inf

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.text import Text

from barc_sim.control.pid import speed_controller
from barc_sim.lab.hills.figure import check_figure
from barc_sim.lab.hills.loop import Comparison
from barc_sim.lab.hills.model import Trajectory
from barc_sim.simulation.closed_loop import closed_loop


@pytest.fixture
def comparison() -> Comparison:
    """Return a poor run beside the reference's."""
    return Comparison(
        closed_loop(controller=speed_controller(2.0, 0.0, 0.0), distance=60.0), closed_loop()
    )


@pytest.fixture
def trajectory() -> Trajectory:
    """Return a model that drifts."""
    t = np.arange(200) * 0.02
    reference = np.zeros((200, 4))
    return Trajectory(t, reference + 1e-3 * t[:, np.newaxis], reference)


def words(comparison: Comparison | None, trajectory: Trajectory | None) -> set[str]:
    figure = check_figure(comparison, trajectory, title='my_lab', settings='kp 2')
    return {text.get_text() for text in figure.findobj(Text)}


def test_all_axes_have_units(comparison: Comparison, trajectory: Trajectory) -> None:
    assert {
        'Speed [m/s]',
        'Grade [°]',
        'Command [m/s²]',
        'Position along the road [m]',
        'Time [s], under the same commands',
        'position [m]',
        'heading [°]',
        'speed [m/s]',
        'my_lab',
        'kp 2',
    } <= words(comparison, trajectory)


def test_only_what_there_is_is_drawn(comparison: Comparison, trajectory: Trajectory) -> None:
    assert len(check_figure(comparison, None).axes) == 4
    assert len(check_figure(None, trajectory).axes) == 1
    with pytest.raises(ValueError, match='no run and no trajectory'):
        check_figure(None, None)


def test_both_runs_are_in_sight_however_fast_one_is(comparison: Comparison) -> None:
    speed, *_ = check_figure(comparison, None).axes
    low, high = speed.get_ylim()
    assert low < 0.0
    assert high > comparison.reference.speed.max()
    assert len(speed.lines) == 2


def test_the_heading_is_clear_of_the_legend(comparison: Comparison, trajectory: Trajectory) -> None:
    for shown in ((comparison, trajectory), (None, trajectory)):
        figure = check_figure(*shown, title='my_lab', settings='kp 2 (controller.py, line 3) ' * 3)
        FigureCanvasAgg(figure).draw()
        legend = figure.axes[0].get_legend()
        assert legend
        box = legend.get_window_extent()
        texts = [text for text in figure.axes[0].texts if text.get_text()]
        assert texts
        assert not any(box.overlaps(text.get_window_extent()) for text in texts)


def test_the_largest_commands_do_not_hide_the_rest(comparison: Comparison) -> None:
    free = closed_loop(controller=speed_controller(limit=inf))
    command = check_figure(Comparison(comparison.user, free), None).axes[-1]
    assert free.motor.max() > 200.0
    assert command.get_ylim()[1] < 20.0


def test_a_model_that_failed_is_drawn_as_far_as_it_went(trajectory: Trajectory) -> None:
    own = trajectory.user.copy()
    own[50:] = np.nan
    (axes,) = check_figure(None, Trajectory(trajectory.t, own, trajectory.reference)).axes
    assert np.isfinite(axes.get_ylim()).all()
