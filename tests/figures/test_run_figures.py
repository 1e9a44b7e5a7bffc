"""Figures of runs, and of drives by hand."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace
from math import sin
from typing import TYPE_CHECKING

import matplotlib as mpl
import numpy as np
import pytest
from hand_drive import drive_by_hand
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.text import Text

from barc_sim.control.driver import DriverInput
from barc_sim.errors import UserError
from barc_sim.figures.files import save
from barc_sim.figures.run_figures import (
    comparison_figure,
    drive_figure,
    plot,
    run_figure,
    speed_figure,
)
from barc_sim.figures.views import frames, view_of
from barc_sim.simulation.closed_loop import closed_loop, lap, simulate
from barc_sim.simulation.log import COLUMNS
from barc_sim.simulation.metrics import summary
from barc_sim.vehicle.plant import NoiseLevels, Plant
from barc_sim.vehicle.road import Road

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from pathlib import Path

    from matplotlib.axes import Axes

    from barc_sim.simulation.log import Log


@pytest.fixture(scope='module')
def log() -> Log:
    return closed_loop()


def without_controller(log: Log) -> Log:
    unknown = np.full(len(log), np.nan)
    return replace(log, reference=unknown, motor=unknown)


def backwards(log: Log) -> Log:
    return replace(log, x=-log.x, v_x=-log.v_x)


def first_state(log: Log) -> Log:
    return log.map(lambda column: column[:1])


def with_misses(log: Log, *states: int) -> Log:
    missed = np.zeros(len(log), dtype=np.bool_)
    missed[list(states)] = True
    return replace(log, missed=missed)


def lines(axes: Axes) -> dict[str, np.ndarray]:
    """Return the named lines of `axes`: label -> points of shape `(n, 2)`."""
    return {
        str(line.get_label()): np.asarray(line.get_xydata())
        for line in axes.lines
        if not str(line.get_label()).startswith('_')
    }


def test_speed_error_grade_and_command_are_drawn_against_the_position(log: Log) -> None:
    speed, error, grade, command = axes = speed_figure(log).axes
    line_of = lines(speed)
    assert set(line_of) == {'speed', 'reference'}
    assert np.array_equal(line_of['speed'], np.column_stack([log.distance, log.speed]))
    assert np.array_equal(line_of['reference'], np.column_stack([log.distance, log.reference]))
    assert np.array_equal(grade.lines[0].get_ydata(), log.theta_deg)
    assert np.array_equal(command.lines[0].get_ydata(), log.motor)
    assert len({each.get_xlim() for each in axes}) == 1

    tops = [each.get_position().y1 for each in axes]
    assert tops == sorted(tops, reverse=True)

    # The error has an axis of its own, after the run-up.
    beyond = log.distance >= 10.0
    errors_after_run_up = np.where(beyond, log.speed_error, np.nan)
    np.testing.assert_array_equal(error.lines[0].get_ydata(), errors_after_run_up)

    low, high = error.get_ylim()
    assert high - low < 1.0
    assert len(speed_figure(log.map(lambda column: column[:10])).axes) == 3


def test_measurements_are_drawn_where_they_differ_from_the_truth() -> None:
    noisy = closed_loop(Plant(noise=NoiseLevels(v_x=0.1)), distance=30.0)
    line_of = lines(speed_figure(noisy).axes[0])
    assert set(line_of) == {'measured', 'speed', 'reference'}
    assert np.array_equal(line_of['measured'][:, 1], noisy.v_x)
    assert np.array_equal(line_of['speed'][:, 1], noisy.speed)


def test_laps_without_noise_have_no_line_of_measurements(log: Log) -> None:
    twice = log.map(lambda column: np.tile(column, 2))
    assert set(lines(speed_figure(twice).axes[0])) == {'lap 1, best', 'lap 2, last', 'reference'}


def laps_of_gains(gains: Sequence[float], *, distance: float = 30.0) -> Log:
    """Return a run whose laps had these gains kp, as its bag has it."""
    logs = [simulate(kp=kp, ki=0.0, kd=0.0, distance=distance) for kp in gains]
    shifts = np.cumsum([0.0, *(log.t[-1] + 0.02 for log in logs[:-1])])
    parts = [replace(log, t=log.t + shift) for log, shift in zip(logs, shifts, strict=True)]
    columns = {name: np.concatenate([part.columns()[name] for part in parts]) for name in COLUMNS}
    kp = np.concatenate([np.full(len(log), kp) for log, kp in zip(logs, gains, strict=True)])
    return replace(parts[0], **columns, parameters={'controller.kp': kp})


def test_the_best_lap_and_the_last_are_in_colour_before_the_others() -> None:
    figure = speed_figure(laps_of_gains([2.0, 20.0, 5.0, 1.0]))
    speed, error, _, command, below = figure.axes
    line_of = {line.get_label(): line for line in speed.lines}
    assert [*line_of] == ['other laps', 'lap 4, last', 'lap 2, best', 'reference']

    colors = [line_of[name].get_color() for name in [*line_of][:3]]
    assert len({*colors}) == 3
    assert [line.get_color() for line in command.lines] == colors
    assert [line.get_color() for line in error.lines][:3] == colors

    # Each is a lap alone; nothing joins two of the others.
    alone = simulate(kp=20.0, ki=0.0, kd=0.0, distance=30.0)
    assert np.array_equal(line_of['lap 2, best'].get_xydata()[:, 1], alone.speed)
    assert np.count_nonzero(np.isnan(line_of['other laps'].get_xdata())) == 1

    (table,) = below.tables
    texts = {place: cell.get_text() for place, cell in table.get_celld().items()}
    assert [texts[k, 6].get_text() for k in range(5)] == ['gains', 'kp 2', 'kp 20', 'kp 5', 'kp 1']
    assert [texts[k, 0].get_color() for k in (4, 2)] == colors[1:]
    assert not figure.get_supxlabel()


def test_a_gain_that_changed_in_a_lap_has_both_values() -> None:
    log = laps_of_gains([2.0])
    kp = np.where(log.t < 3.0, 2.0, 4.0)
    figure = run_figure(replace(log, parameters={'controller.kp': kp}), {'kp': '2.0'}, '', None)
    assert 'kp 2 → 4' in {text.get_text() for text in figure.findobj(Text)}


def test_without_controller_the_speed_stands_alone(log: Log) -> None:
    figure = speed_figure(without_controller(log))
    assert set(lines(figure.axes[0])) == {'speed'}
    assert not figure.get_supxlabel()


def test_missed_deadlines_are_marked_and_counted(log: Log) -> None:
    marked = lines(speed_figure(with_misses(log, 100, 900)).axes[-1])
    assert np.array_equal(marked['2 missed deadlines'][:, 0], log.distance[[100, 900]])
    assert '1 missed deadline' in lines(speed_figure(with_misses(log, 7)).axes[-1])
    assert not lines(speed_figure(log).axes[-1])


def test_the_caption_has_the_error_after_the_run_up_and_of_the_whole_run(log: Log) -> None:
    beyond = log.speed_error[log.distance >= 10.0]
    caption = speed_figure(log).get_supxlabel()
    assert f'after the first 10 m: RMS {np.sqrt(np.mean(beyond**2)):.3f} m/s' in caption
    assert f'whole run: RMS {np.sqrt(np.mean(log.speed_error**2)):.3f} m/s' in caption


@pytest.mark.parametrize(
    'change',
    [
        lambda log: log,
        without_controller,
        backwards,
        first_state,
        lambda log: with_misses(log, 3, 700),
        lambda _: closed_loop(Plant(road=Road.flat()), distance=30.0),
        lambda _: closed_loop(Plant(noise=NoiseLevels(s=0.1, v_x=0.3)), distance=30.0),
    ],
    ids=['lab', 'no controller', 'backwards', 'one state', 'misses', 'flat', 'noise'],
)
def test_no_words_overlap_or_leave_the_figure(log: Log, change: Callable[[Log], Log]) -> None:
    figure = speed_figure(change(log), title='2026-11-21_12-00-00', settings='road lab')
    assert_words_are_apart(figure)


def assert_words_are_apart(figure: Figure) -> None:
    FigureCanvasAgg(figure).draw()
    words = [*figure.texts]
    for axes in figure.axes:
        # A legend's own words are laid out by it; ticks keep clear of each other.
        ticks = [*axes.get_xticklabels(), *axes.get_yticklabels()]
        legend = axes.get_legend()
        within = [*ticks, *(legend.get_texts() if legend else [])]
        words += [text for text in axes.findobj(Text) if text not in within]
        words += [legend] if legend else []
    boxes = [word.get_window_extent() for word in words]
    boxes = [box for box in boxes if box.width > 1.0]
    assert len(boxes) >= 6
    for i, box in enumerate(boxes):
        assert figure.bbox.x0 <= box.x0 <= box.x1 <= figure.bbox.x1
        assert figure.bbox.y0 <= box.y0 <= box.y1 <= figure.bbox.y1
        assert not any(box.overlaps(other) for other in boxes[:i])


def test_no_words_of_a_comparison_overlap_or_leave_the_figure(log: Log) -> None:
    labels = ['kp 30', 'stanley, noise_v_x 0.05, sensor_delay 0.04, servo_delay 0.06', 'lqr']
    logs = [log, simulate(kp=5.0), simulate(road='flat')]
    figure = comparison_figure(logs, labels, title='3 runs', settings='road lab')
    assert_words_are_apart(figure)


def test_a_users_own_style_changes_nothing(log: Log) -> None:
    with mpl.rc_context({'figure.facecolor': 'black', 'lines.linewidth': 9.0, 'font.size': 30.0}):
        figure = speed_figure(log)
    assert figure.get_facecolor() == (1.0, 1.0, 1.0, 1.0)
    assert figure.axes[0].yaxis.label.get_fontsize() == 10.0


USERS_STYLE = {
    'figure.facecolor': 'black',
    'savefig.facecolor': 'red',
    'savefig.bbox': 'tight',
    'lines.linewidth': 9.0,
    'font.size': 30.0,
    'xtick.color': 'red',
    'xtick.major.size': 30.0,
}


@pytest.mark.parametrize('kind', ['file', 'notebook', 'video'])
def test_a_users_own_style_changes_no_saved_figure(log: Log, tmp_path: Path, kind: str) -> None:
    def saved() -> bytes:
        if kind == 'video':
            view = view_of(log, Figure())
            return next(frames(view, [1.0])).tobytes()
        if kind == 'notebook':
            return plot(log)._repr_png_()
        path = tmp_path / 'speed.png'
        save(speed_figure(log), path)
        return path.read_bytes()

    usual = saved()
    with mpl.rc_context(USERS_STYLE):
        with_style = saved()
    assert (with_style == usual) is True  # short, where it fails


def test_drawing_opens_no_window_and_leaves_pyplot_alone() -> None:
    program = (
        'import sys; from barc_sim.figures.run_figures import speed_figure;'
        'from barc_sim.simulation.closed_loop import closed_loop;'
        'speed_figure(closed_loop(distance=1.0)); print("matplotlib.pyplot" in sys.modules)'
    )
    result = subprocess.run(
        [sys.executable, '-c', program], capture_output=True, text=True, check=True
    )

    assert result.stdout.strip() == 'False'


REQUESTS = [(0.2 * k, DriverInput(forward=0.5, turn=0.5 * sin(k / 5))) for k in range(40)]


def test_path_heading_speed_and_steering_are_drawn() -> None:
    log = drive_by_hand(REQUESTS, 8.0)
    path, heading, speed, steering = drive_figure(log, title='mine').axes

    assert path.get_title(loc='left') == 'mine'
    assert path.get_aspect() == 1.0
    np.testing.assert_array_equal(path.lines[0].get_xydata(), np.c_[log.distance, log.across])
    assert heading.lines[0].get_ydata()[-1] == np.degrees(log.psi[-1])
    np.testing.assert_array_equal(speed.lines[0].get_xydata(), np.c_[log.t, log.speed])
    assert steering.lines[0].get_ydata().max() == np.degrees(log.servo.max())
    assert 'Time [s]' in steering.get_xlabel()


def test_the_heading_starts_again_after_a_reset() -> None:
    """A reset turns the car back to 0°, however far it had turned."""
    left = drive_by_hand([(0.2 * k, DriverInput(forward=0.5, turn=0.8)) for k in range(30)], 6.0)
    turned = np.degrees(left.psi[-1])
    assert 180.0 < turned < 540.0

    twice = left.map(lambda column: np.tile(column, 2))
    twice = replace(twice, t=0.02 * np.arange(len(twice)))
    _, heading, _, steering = drive_figure(twice).axes
    degrees = heading.lines[0].get_ydata()
    assert degrees[len(left) - 2] == pytest.approx(turned, abs=10.0)
    assert degrees[len(left)] == 0.0
    for axes in (heading, steering):
        assert np.isnan(axes.lines[0].get_ydata()[len(left) - 1])


def test_a_drive_straight_on_has_speed_and_command() -> None:
    log = without_controller(closed_loop(Plant(road=Road.flat()), distance=30.0))
    speed, command = drive_figure(log).axes
    np.testing.assert_array_equal(speed.lines[0].get_xydata(), np.c_[log.t, log.speed])
    np.testing.assert_array_equal(command.lines[0].get_xydata(), np.c_[log.t, log.motor])


def test_reset_to_the_start_breaks_the_lines() -> None:
    log = drive_by_hand(REQUESTS, 8.0)
    x = np.where(log.t < 6.0, log.x, 0.0)
    path, _, speed, _ = drive_figure(replace(log, x=x)).axes
    k = int(np.searchsorted(log.t, 6.0)) - 1
    assert np.isnan(path.lines[0].get_xdata()).nonzero()[0].tolist() == [k]
    assert np.isnan(speed.lines[0].get_ydata()).nonzero()[0].tolist() == [k]


# Several runs


def test_several_runs_have_a_line_each_in_one_figure(log: Log) -> None:
    shorter = log.map(lambda column: column[:500])
    figure = plot(shorter, log, labels=['part'])
    speed, error, grade, command, _ = figure.axes
    for axes in (speed, error, command):
        first, second, *_ = axes.get_lines()
        assert (len(first.get_xdata()), len(second.get_xdata())) == (500, len(log))
        assert first.get_color() != second.get_color()
    # The speed to hold and the slopes are those of both: they are drawn once.
    assert [len(line) for line in lines(speed).values()] == [500, len(log), len(log)]
    assert [*lines(speed)] == ['part', 'run 2', 'reference']
    assert [len(line.get_xdata()) for line in grade.get_lines()] == [len(log)]
    assert len(grade.collections) == 1

    low, high = speed.get_ylim()
    assert 7.0 < low < log.speed[log.distance > 10.0].min()
    assert log.speed.max() < high < 9.0


def test_each_of_several_runs_has_a_row_of_errors(log: Log) -> None:
    other = simulate(kp=5.0)
    (table,) = plot(log, other).axes[-1].tables
    words = {cell.get_text().get_text() for cell in table.get_celld().values()}
    assert {'run 1', 'run 2', 'overshoot'} <= words
    for one_run in (log, other):
        assert f'{summary(one_run).rms_error_after_run_up:.3f} m/s' in words


def test_slopes_that_differ_have_a_line_for_each_run(log: Log) -> None:
    grade = plot(log, simulate(road='flat'), simulate(kp=5.0)).axes[2]
    assert len(grade.get_lines()) == 3
    assert not grade.collections


def test_slopes_are_alike_wherever_the_states_of_two_runs_lie(log: Log) -> None:
    runs = [simulate(speed_reference=5.0), simulate(ts=0.03), simulate(distance=50.0)]
    grade = plot(log, *runs).axes[2]
    assert len(grade.get_lines()) == len(grade.collections) == 1


def test_more_runs_than_colours_differ_by_their_dashes(log: Log) -> None:
    short = log.map(lambda column: column[:100])
    speed = plot(*[short] * 8).axes[0]
    styles = {(line.get_color(), line.get_linestyle()) for line in speed.get_lines()[:8]}
    assert len(styles) == 8


def test_recorded_runs_are_labelled_by_what_differs() -> None:
    logs = []
    for kp, noise in ((5.0, 0.0), (20.0, 0.0), (20.0, 0.1)):
        log = simulate(kp=kp, noise=noise, distance=20.0)
        values = {'controller.kp': kp, 'controller.ki': 200.0, 'vehicle_simulator.noise_v_x': noise}
        parameters = {name: np.full(len(log), value) for name, value in values.items()}
        logs.append(replace(log, parameters=parameters))
    assert [*lines(plot(*logs).axes[0])][:3] == ['kp 5', 'kp 20', 'kp 20, noise_v_x 0.1']
    assert [*lines(plot(*logs, labels=['a']).axes[0])][:2] == ['a', 'kp 20']


@pytest.mark.parametrize(
    ('further_logs', 'sentence'),
    [
        ([simulate(distance=5.0)], 'runs on a track and on a road have no position in common'),
        (
            [lap(track='L', laps=1, speed=9.0)],
            "runs on the tracks 'oval' and 'L' have no position in common",
        ),
    ],
)
def test_runs_on_different_courses_cannot_be_compared(
    further_logs: list[Log], sentence: str
) -> None:
    with pytest.raises(UserError, match=f'^{sentence} .*: plot them apart$'):
        plot(lap(track='oval', laps=1), *further_logs)


def test_plot_draws_into_the_users_axes(log: Log) -> None:
    left, right = Figure().subplots(1, 2)
    assert log.plot(log, ax=right) is right.figure
    assert (len(left.get_lines()), len(right.get_lines())) == (0, 4)


def test_a_plot_of_nothing_is_refused(log: Log) -> None:
    for logs in ((), (log, log.map(lambda column: column[:0]))):
        with pytest.raises(UserError, match='at least one log with a state'):
            plot(*logs)
    with pytest.raises(UserError, match=r'^plot: \[<Log: .* is not a log'):
        plot([log])  # type: ignore[arg-type]
