"""The figure of errors by step: what each panel shows."""

from __future__ import annotations

import pytest

from barc_sim.figures.convergence_figure import convergence_figure
from barc_sim.simulation.convergence import STEPS, Study

FALLING = (1e-2, 5e-3, 2.5e-3, 1.25e-3, 6e-4)


def study(test_drive: str, model: str, errors: tuple[float, ...] = FALLING) -> Study:
    return Study(test_drive, 'text', 'the closed form', model, 'euler', errors, 1.0)


STUDIES = [study('circle', 'kinematic'), study('hills', 'kinematic'), study('hills', 'dynamic')]


def test_each_drive_has_a_panel_with_a_line_for_each_of_its_studies() -> None:
    circle, hills, *rest = convergence_figure(STUDIES).axes
    assert (circle.get_title(loc='left'), hills.get_title(loc='left')) == ('circle', 'hills')
    solid = [
        [line for line in axes.lines if line.get_linestyle() == '-'] for axes in (circle, hills)
    ]
    assert [len(lines) for lines in solid] == [1, 2]
    assert solid[0][0].get_xdata() == pytest.approx(STEPS)
    assert solid[0][0].get_ydata() == pytest.approx(FALLING)
    assert not any(axes.axison for axes in rest)


def test_both_axes_are_logarithmic_and_tell_the_steps_in_milliseconds() -> None:
    figure = convergence_figure(STUDIES)
    figure.draw_without_rendering()
    axes = figure.axes[0]
    assert (axes.get_xscale(), axes.get_yscale()) == ('log', 'log')
    assert sorted(label.get_text() for label in axes.get_xticklabels()) == sorted(
        f'{1e3 * ts:g}' for ts in STEPS
    )


def test_reference_lines_have_slopes_1_and_4() -> None:
    axes = convergence_figure(STUDIES).axes[0]
    dashed = [line for line in axes.lines if line.get_linestyle() == '--']
    falls = [line.get_ydata()[0] / line.get_ydata()[1] for line in dashed]
    assert falls == pytest.approx([2.0, 16.0])


def test_both_models_are_seen_where_they_have_the_same_error() -> None:
    hills = convergence_figure(STUDIES).axes[1]
    kinematic, dynamic = (line for line in hills.lines if line.get_linestyle() == '-')
    assert kinematic.get_marker() != dynamic.get_marker()
    assert dynamic.get_markerfacecolor() == 'none'


def test_error_of_zero_is_drawn() -> None:
    figure = convergence_figure([study('circle', 'kinematic', (1e-2, 0.0, 0.0, 0.0, 0.0))])
    figure.draw_without_rendering()
