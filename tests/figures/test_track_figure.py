"""Figures of laps of a track: the track is where it is, and the laps are those of the log."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import to_hex
from matplotlib.figure import Figure
from matplotlib.text import Text

from barc_sim.control.lane import LaneLQR, Stanley, speed_profile
from barc_sim.figures.colours import BLUE, VERMILLION
from barc_sim.figures.run_figures import plot, run_figure
from barc_sim.figures.track_figure import draw_course, track_figure
from barc_sim.figures.views import SIZE, TopView, view_of
from barc_sim.simulation.closed_loop import lap
from barc_sim.simulation.metrics import track_laps_of
from barc_sim.vehicle.track import Track

if TYPE_CHECKING:
    from barc_sim.simulation.log import TrackLog


@pytest.fixture(scope='module')
def log() -> TrackLog:
    """Return laps of which the second is the fastest: noise makes each another one."""
    profile = speed_profile(Track.named('L'), maximum=8.0, across=3.0, along=2.0)
    return lap(Stanley(), 'L', speed=profile, laps=3, noise=0.05, seed=3)


def test_edges_are_half_the_width_from_the_line() -> None:
    track = replace(Track.named('figure-eight'), width=4.0)
    axes = Figure().subplots()
    _, left, right, centre, finish = draw_course(axes, track)
    for line, e_y in ((left, 2.0), (right, -2.0), (centre, 0.0)):
        x, y = line.get_data()
        places = track.frenet(x, y, np.zeros(len(x)), near=track.samples())
        np.testing.assert_allclose(places.e_y, e_y, atol=1e-9)
        np.testing.assert_allclose(places.s, track.samples(), atol=1e-9)

    assert np.ptp(finish.get_data()) == pytest.approx(4.0)


@pytest.mark.parametrize('length', [0.0, 20_832.0])  # that of the Nordschleife
def test_the_metres_beside_the_track_stand_within_the_axes(length: float) -> None:
    log = lap(track='figure-eight', laps=1)
    from_above, *_ = track_figure(
        replace(log, track=Track((length,), (0.0,))) if length else log
    ).axes
    FigureCanvasAgg(from_above.figure).draw()
    places = [text.get_position() for text in from_above.texts if text.get_text().endswith(' m')]
    assert len(places) > 5
    assert all(from_above.viewLim.contains(*place) for place in places)


def test_laps_are_those_of_the_log(log: TrackLog) -> None:
    laps, numbers = track_laps_of(log)
    assert [each.time for each in laps.finished] == log.lap_times.tolist()

    assert laps.best
    assert laps.best.time == log.best

    rows = np.equal(numbers, laps.best.number)
    assert laps.best.maximum == np.abs(log.e_y[rows]).max()
    assert laps.best.rms == pytest.approx(np.sqrt(np.mean(log.e_y[rows] ** 2)))

    figure = track_figure(log)
    (table,) = figure.axes[1].tables
    times = [table[k, 1].get_text().get_text() for k in (1, 2, 3)]
    assert times == [f'{each:.2f} s' for each in log.lap_times]

    (across,) = [line for line in figure.axes[2].lines if to_hex(line.get_color()) == BLUE.lower()]
    np.testing.assert_array_equal(across.get_ydata(), log.e_y[rows])


def test_states_at_the_limit_are_counted() -> None:
    class Hard(LaneLQR):
        def steer_calculate(self, e_y: float, *_: object) -> float:
            return 0.5 if e_y < 0.0 else -0.5

    log = lap(Hard(), 'oval', laps=1)
    laps, _ = track_laps_of(log)
    assert laps.current.at_limit == 1.0


def test_a_reset_begins_a_lap_that_no_time_is_taken_of(log: TrackLog) -> None:
    rows = [*range(1300), *range(len(log))]
    again = log.map(lambda column: column[rows])
    laps, _ = track_laps_of(again)
    assert [each.time for each in laps.finished[-3:]] == pytest.approx(log.lap_times.tolist())
    assert again.best == pytest.approx(log.best)
    track_figure(again)


def test_a_state_whose_place_is_unknown_begins_no_lap(log: TrackLog) -> None:
    fields = ('s', 'e_y', 'e_psi', 'curvature', 'lap', 'lap_time')
    gaps = {name: getattr(log, name).copy() for name in fields}
    for column in gaps.values():
        column[[0, 700, 2000]] = np.nan
    laps, numbers = track_laps_of(replace(log, **gaps))
    assert [*dict.fromkeys(numbers)] == [0, 1, 2, 3]
    assert [each.time for each in laps.finished] == pytest.approx(log.lap_times.tolist())
    track_figure(replace(log, **gaps))


def test_every_run_has_a_figure(log: TrackLog) -> None:
    unfinished = log.map(lambda column: column[:300])
    single_state = log.map(lambda column: column[:1])
    without_errors = replace(log, e_v_x=np.full(len(log), np.nan))
    for run in (log, unfinished, single_state, without_errors):
        info = {'track': 'L', 'lane': 'stanley', 'kp': '30.0'}
        figure = run_figure(run, info, '2026-11-21_12-00-00', None)
        FigureCanvasAgg(figure).draw()
        words = [text for text in figure.findobj(Text) if text.get_text()]
        assert 'track L · lane stanley · kp 30.0' in [word.get_text() for word in words]
    single = lap(Stanley(), 'L', laps=1)
    assert len({*track_laps_of(single)[1]}) == 2  # the last state is behind the line

    legend = track_figure(single).axes[2].get_legend()
    assert [text.get_text() for text in legend.get_texts()] == ['best lap: 1']

    comparison = plot(log, unfinished, labels=['all', 'some'])
    legend = comparison.axes[2].get_legend()
    assert [text.get_text() for text in legend.get_texts()] == ['all', 'some']
    # The whole track, though this run has not driven along it; where it is unknown, the way alone.
    for figure in (plot(unfinished), plot(replace(unfinished, track=None), log)):
        assert '160 m' in [text.get_text() for text in figure.axes[0].texts]

    unknown = replace(log, track=None)
    assert '160 m' not in [text.get_text() for text in plot(unknown).axes[0].texts]

    view_of(unknown, Figure(figsize=SIZE, dpi=50)).update(5.0)


def test_the_last_lap_has_its_colour_and_each_lap_its_gains(log: TrackLog) -> None:
    numbers = np.array(track_laps_of(log)[1])
    k = np.where(numbers == 0, 0.5, 1.5)
    figure = track_figure(replace(log, parameters={'controller.lane.k': k}))
    legend = [text.get_text() for text in figure.axes[2].get_legend().get_texts()]
    assert legend == ['other laps', 'last lap: 3', 'best lap: 2']

    (table,) = figure.axes[1].tables
    texts = {place: cell.get_text() for place, cell in table.get_celld().items()}
    assert [texts[row, 5].get_text() for row in range(4)] == ['gains', 'k 0.5', 'k 1.5', 'k 1.5']

    colors = [to_hex(texts[row, 0].get_color()).upper() for row in range(1, 4)]
    assert colors[1:] == [BLUE, VERMILLION]
    assert colors[0] not in colors[1:]


def texts_of_rows(figure: Figure) -> list[list[Text]]:
    """Return the texts of the table in each row, from left to right."""
    (table,) = figure.axes[1].tables
    cells = table.get_celld()
    rows = 1 + max(row for row, _ in cells)
    columns = 1 + max(column for _, column in cells)
    return [[cells[row, column].get_text() for column in range(columns)] for row in range(rows)]


def test_no_cell_of_a_table_covers_another(log: TrackLog) -> None:
    long_gains = {
        f'controller.lane.{name}': np.full(len(log), 0.123456) for name in ('q_e_y', 'q_change')
    }
    unfinished = log.map(lambda column: column[:800])
    figures = [
        track_figure(log),
        track_figure(replace(log, parameters=long_gains)),
        track_figure(replace(log, parameters=long_gains).map(lambda column: column[:800])),
        track_figure(unfinished, log, labels=['q_e_y=100, q_e_psi=0.5', 'weights as always']),
    ]

    for figure in figures:
        FigureCanvasAgg(figure).draw()
        for texts in texts_of_rows(figure):
            boxes = [text.get_window_extent() for text in texts]
            assert boxes[0].x0 > 0.0
            gaps = [right.x0 - left.x1 for left, right in pairwise(boxes)]
            assert min(gaps) > 0.5 * texts[0].get_fontsize()


def test_the_pale_car_of_a_video_is_the_best_lap_at_the_same_time(log: TrackLog) -> None:
    view = view_of(log, Figure(figsize=SIZE, dpi=50), 'a run')
    assert isinstance(view, TopView)

    laps, _ = track_laps_of(log)
    assert laps.best
    other = next(each for each in laps.finished if each.number != laps.best.number)
    view.update(other.start + 10.0)
    here, there = (view._body, view._ghost)  # noqa: SLF001 (an artist has no other place)
    offset = there.transform((0.0, 0.0)) - here.transform((0.0, 0.0))
    x, y = (
        np.interp(laps.best.start + 10.0, log.t, each) - np.interp(other.start + 10.0, log.t, each)
        for each in view.course
    )
    assert offset == pytest.approx((x, y), abs=1e-9)
