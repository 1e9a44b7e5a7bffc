"""Rows: what belongs to a state is joined to it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from barc_sim.control.lqr import LQR
from barc_sim.page.protocol import COLUMNS
from barc_sim.page.rows import Rows, columns_in, rows_of
from barc_sim.simulation.closed_loop import closed_loop

if TYPE_CHECKING:
    from collections.abc import Mapping

STEP = 20_000_000


def table(data: bytes) -> dict[str, Any]:
    columns = np.frombuffer(data, '<f8').reshape(-1, len(COLUMNS)).T
    return dict(zip(COLUMNS, columns, strict=True))


def test_time_counts_from_the_first_state() -> None:
    rows = Rows()
    first = table(rows.add([(7 * STEP, (0.0, 0.0, 0.0, 0.0, 0.0))], {}))
    later = table(rows.add([(57 * STEP, (0.0, 0.0, 0.0, 0.0, 0.0))], {}))
    assert first['t'] == 0.0
    assert later['t'] == 1.0


def test_what_was_never_heard_is_nan_and_the_measurement_counts_as_true() -> None:
    row = table(Rows().add([(1, (3.0, 4.0, 0.5, 6.0, 8.0))], {}))
    assert (row['x'], row['y'], row['psi'], row['speed']) == (3.0, 4.0, 0.5, 6.0)
    for name in ('theta_deg', 'elevation', 'motor', 'servo', 'reference', 'integral'):
        assert np.isnan(row[name])


def test_a_sample_goes_with_the_state_of_its_stamp_and_holds_until_the_next() -> None:
    rows = Rows()
    states = [(k * STEP, (0.0,) * 5) for k in range(4)]
    commands = [(1 * STEP, (1.0, 0.1)), (3 * STEP, (3.0, 0.3))]
    found = table(rows.add(states, {'ecu': commands}))
    np.testing.assert_array_equal(found['motor'], [np.nan, 1.0, 1.0, 3.0])
    np.testing.assert_array_equal(found['servo'], [np.nan, 0.1, 0.1, 0.3])


def test_a_sample_that_comes_before_its_state_waits_for_it() -> None:
    rows = Rows()
    rows.add([], {'environment': [(STEP, (10.0, 2.0, -1.0, -2.0, -3.0))]})
    found = table(rows.add([(0, (0.0,) * 5), (STEP, (0.0,) * 5)], {}))
    np.testing.assert_array_equal(found['theta_deg'], [np.nan, 10.0])
    np.testing.assert_array_equal(found['gravity'], [np.nan, -3.0])


def test_a_command_without_a_stamp_holds_from_when_it_is_heard() -> None:
    rows = Rows()
    found = table(rows.add([(5 * STEP, (0.0,) * 5)], {'ecu': [(0, (2.0, 0.0))]}))
    assert found['motor'] == 2.0


def test_the_truth_is_shown_where_the_error_is_known() -> None:
    error = (0.3, 0.4, 0.0, 0.5, 0.25)
    found = table(Rows().add([(1, (10.0, 0.0, np.pi / 2, 6.0, 12.25))], {'ez_vhcl': [(1, error)]}))
    assert found['x'] == pytest.approx(10.4)
    assert found['y'] == pytest.approx(-0.3)
    assert found['speed'] == 5.5
    assert found['measured_speed'] == 6.0
    assert found['absolute_speed'] == pytest.approx(np.hypot(5.5, 12.0))


def test_a_page_that_opens_late_gets_the_last_minute() -> None:
    rows = Rows()
    for k in range(4000):
        rows.add([(k * STEP, (float(k), 0.0, 0.0, 50.0, 0.0))], {})
    history = table(rows.history())
    np.testing.assert_array_equal(history['x'], np.arange(1000, 4000))


def test_a_run_of_another_controller_has_its_terms() -> None:
    class Own(LQR):
        """One that no table has."""

        terms: Mapping[str, str] = {'own': 'whatever it is'}

        @property
        def own(self) -> float:
            """A part of the output."""
            return self.feedback

    log = closed_loop(controller=Own(output_min=-8.0, output_max=8.0), distance=3.0)
    assert columns_in(log) == (*COLUMNS, 'own')
    rows = np.frombuffer(rows_of(log), '<f8').reshape(len(log), -1)
    np.testing.assert_array_equal(rows[:, -1], log.terms['own'])


def test_a_whole_run_has_the_same_columns() -> None:
    log = closed_loop()
    found = table(rows_of(log))
    np.testing.assert_array_equal(found['t'], log.t)
    np.testing.assert_array_equal(found['x'], log.distance)
    np.testing.assert_array_equal(found['speed'], log.speed)
    for name in ('theta_deg', 'gravity', 'motor', 'reference', 'integral', 'saturated'):
        np.testing.assert_array_equal(found[name], getattr(log, name))
