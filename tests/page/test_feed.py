"""The rows of a feed: each state with its other messages, in the time of the run."""

from __future__ import annotations

from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from barc_sim.control.speed import LQR
from barc_sim.page.feed import Feed, columns_in, rows_of
from barc_sim.page.protocol import COLUMNS
from barc_sim.simulation.closed_loop import closed_loop

if TYPE_CHECKING:
    from collections.abc import Mapping

STEP = 20_000_000  #: [ns]
AT_REST = {'x': 0.0, 'y': 0.0, 'psi': 0.0, 'v_x': 0.0, 'v_y': 0.0}


def message(stamp: int, **fields: float) -> Any:  # noqa: ANN401 (of no type of ROS's)
    """Return a message stamped `stamp` [ns]."""
    header = SimpleNamespace(stamp=SimpleNamespace(sec=0, nanosec=stamp))
    return SimpleNamespace(header=header, **fields)


def add(feed: Feed, *states: Any, **messages_by_topic: Any) -> Any:  # noqa: ANN401
    """Return the columns of the rows of `states`, by name."""
    for topic, messages in messages_by_topic.items():
        for each in messages:
            feed.take(topic, each)
    for state in states:
        feed.take('z_vhcl', state)
    return table(feed.poll())


def table(data: bytes) -> dict[str, Any]:
    columns = np.frombuffer(data, '<f8').reshape(-1, len(COLUMNS)).T
    return dict(zip(COLUMNS, columns, strict=True))


def test_values_without_a_message_are_nan_and_the_measurement_counts_as_true() -> None:
    row = add(Feed(), message(1, x=3.0, y=4.0, psi=0.5, v_x=6.0, v_y=8.0))
    assert (row['x'], row['y'], row['psi'], row['speed']) == (3.0, 4.0, 0.5, 6.0)
    for name in ('theta_deg', 'elevation', 'motor', 'servo', 'reference', 'integral'):
        assert np.isnan(row[name])


def test_a_sample_goes_with_the_state_of_its_stamp_and_holds_until_the_next() -> None:
    states = [message(k * STEP, **AT_REST) for k in range(4)]
    commands = [message(k * STEP, motor=1.0 * k, servo=0.1 * k) for k in (1, 3)]
    rows = add(Feed(), *states, ecu=commands)
    np.testing.assert_array_equal(rows['motor'], [np.nan, 1.0, 1.0, 3.0])
    np.testing.assert_allclose(rows['servo'], [np.nan, 0.1, 0.1, 0.3])


def test_a_sample_that_comes_before_its_state_waits_for_it() -> None:
    feed = Feed()
    slope = message(STEP, theta=10.0, elevation=2.0, friction=-1.0, drag=-2.0, gravity=-3.0)
    add(feed, environment=[slope])
    rows = add(feed, message(0, **AT_REST), message(STEP, **AT_REST))
    np.testing.assert_array_equal(rows['theta_deg'], [np.nan, 10.0])
    np.testing.assert_array_equal(rows['gravity'], [np.nan, -3.0])


def test_a_command_without_a_stamp_holds_from_its_arrival() -> None:
    rows = add(Feed(), message(5 * STEP, **AT_REST), ecu=[message(0, motor=2.0, servo=0.0)])
    assert rows['motor'] == 2.0


def test_the_truth_is_shown_where_the_error_is_known() -> None:
    error = message(1, s=0.3, ey=0.4, epsi=0.0, v_x=0.5, v_y=0.25)
    state = message(1, x=10.0, y=0.0, psi=np.pi / 2, v_x=6.0, v_y=12.25)
    rows = add(Feed(), state, ez_vhcl=[error])
    assert rows['x'] == pytest.approx(10.4)
    assert rows['y'] == pytest.approx(-0.3)
    assert rows['speed'] == 5.5
    assert rows['measured_speed'] == 6.0
    assert rows['absolute_speed'] == pytest.approx(np.hypot(5.5, 12.0))


def test_a_page_that_opens_late_gets_the_last_minute() -> None:
    feed = Feed()
    for k in range(4000):
        add(feed, message(k * STEP, **AT_REST | {'x': float(k), 'v_x': 50.0}))
    history = table(feed.history())
    np.testing.assert_array_equal(history['x'], np.arange(1000, 4000))


def test_a_recorded_run_has_the_terms_of_a_users_controller() -> None:
    class Own(LQR):
        """A controller that no table has."""

        terms: Mapping[str, str] = {'own': 'whatever it is'}

        @property
        def own(self) -> float:
            """A part of the output."""
            return self.feedback

    log = closed_loop(controller=Own(output_min=-8.0, output_max=8.0), distance=3.0)
    assert columns_in(log) == (*COLUMNS, 'own')
    rows = np.frombuffer(rows_of(log), '<f8').reshape(len(log), -1)
    np.testing.assert_array_equal(rows[:, -1], log.terms['own'])


def test_a_recorded_run_has_the_values_of_its_log() -> None:
    log = closed_loop()
    columns = table(rows_of(log))
    np.testing.assert_array_equal(columns['t'], log.t)
    np.testing.assert_array_equal(columns['x'], log.distance)
    np.testing.assert_array_equal(columns['speed'], log.speed)
    for name in ('theta_deg', 'gravity', 'motor', 'reference', 'integral', 'saturated'):
        np.testing.assert_array_equal(columns[name], getattr(log, name))
