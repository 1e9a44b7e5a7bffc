"""The figure of a search."""

from __future__ import annotations

import io
from typing import TYPE_CHECKING

import numpy as np
import pytest
from matplotlib.colors import LogNorm
from matplotlib.text import Text

from barc_sim.control.speed import speed_controller
from barc_sim.figures.tuning_figures import Point, tuning_figure
from barc_sim.tuning.batch import Course
from barc_sim.tuning.search import Surface

if TYPE_CHECKING:
    from matplotlib.figure import Figure

COURSE = Course()
KP, KI = np.linspace(0.0, 60.0, 7), np.linspace(0.0, 900.0, 5)
COST = 0.01 + np.add.outer(KI / 900.0, KP / 60.0)


def point(kp: float, ki: float, kd: float) -> Point:
    return Point(np.array([kp, ki, kd]), COURSE.drive(speed_controller(kp, ki, kd)))


START, FOUND = point(10.0, 20.0, 0.0), point(45.0, 800.0, 0.1)


def drawn(cost: np.ndarray = COST, start: Point = START, found: Point = FOUND) -> Figure:
    return tuning_figure(
        Surface((0, 1), KP, KI, cost), start, found, cost='RMS speed error [m/s]', title='A title'
    )


def words(figure: Figure) -> set[str]:
    return {text.get_text() for text in figure.findobj(Text)}


def test_start_and_found_are_marked_on_the_map() -> None:
    plane = drawn().axes[0]
    marks = {line.get_label(): line.get_xydata() for line in plane.lines}
    assert np.asarray(marks['start']).tolist() == [[10.0, 20.0]]
    assert np.asarray(marks['found']).tolist() == [[45.0, 800.0]]


def test_the_runs_before_and_after_are_drawn_as_they_were() -> None:
    response, errors = drawn().axes[1:3]
    for axes, name in ((response, 'speed'), (errors, 'speed_error')):
        lines = {line.get_label(): line.get_ydata() for line in axes.lines}
        for label, log in (('start', START.log), ('found', FOUND.log)):
            expected = getattr(log, name)
            if name == 'speed_error':
                expected = expected[log.distance >= 10.0]
            assert np.array_equal(np.asarray(lines[label]), expected)


def test_a_cost_over_decades_is_shown_by_its_logarithm_and_others_as_they_are() -> None:
    wide = drawn(10.0**COST * 1e-3 * np.linspace(1.0, 100.0, COST.size).reshape(COST.shape))
    assert isinstance(wide.axes[0].collections[0].norm, LogNorm)
    for cost in (COST * 0.0, COST * 0.1 + 1.0, COST - COST.min()):
        assert not isinstance(drawn(cost).axes[0].collections[0].norm, LogNorm)


@pytest.mark.parametrize('lost', [1, COST.size])
def test_gains_that_never_arrive_are_left_white_with_a_note(lost: int) -> None:
    cost = COST.copy()
    cost.flat[:lost] = np.inf
    figure = drawn(cost)
    mesh = figure.axes[0].collections[0]
    assert np.ma.count_masked(np.ma.asarray(mesh.get_array())) == lost
    assert any('white: never arrives' in text for text in words(figure))
    assert not any('never arrives' in text for text in words(drawn()))


def test_a_run_that_never_reaches_its_speed_is_drawn() -> None:
    figure = drawn(start=point(0.5, 0.0, 0.0))
    figure.savefig(io.BytesIO(), format='png', dpi=40)
    assert figure.axes[1].get_xlim()[1] > 10.0


def test_the_caption_has_the_gain_that_the_map_does_not_show() -> None:
    assert any('Map at kd = 0.1; the start has 0' in text for text in words(drawn()))
