"""Deadlines by the wall clock: kept, passed late, and given up."""

from __future__ import annotations

import pytest

from barc_sim.simulation.pacing import PUNCTUAL, Pace


@pytest.fixture
def pace() -> Pace:
    pace = Pace(0.02)
    pace.begin(100.0)
    return pace


def test_deadlines_are_a_period_apart_however_late_each_is_noticed(pace: Pace) -> None:
    assert pace.pass_deadline(100.021)
    assert pace.pass_deadline(100.0415)
    assert not pace.pass_deadline(100.063)
    assert pace.slipped == 0


def test_deadline_noticed_early_is_kept(pace: Pace) -> None:
    assert pace.pass_deadline(100.0199)
    assert pace.pass_deadline(100.04)


def test_deadline_is_kept_up_to_a_share_of_the_period(pace: Pace) -> None:
    assert pace.pass_deadline(100.02 + 0.99 * PUNCTUAL * 0.02)
    assert not pace.pass_deadline(100.04 + 1.01 * PUNCTUAL * 0.02)


def test_whole_periods_that_were_lost_are_counted_and_given_up(pace: Pace) -> None:
    assert not pace.pass_deadline(100.071)  # due at 100.02, 2.55 periods ago

    assert pace.slipped == 2
    assert pace.pass_deadline(100.0805)
    assert pace.slipped == 2
