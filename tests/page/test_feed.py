"""The feed: the time of the rows is that of the run, whatever the stamps do."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from barc_sim.page.feed import NANOSECONDS, Feed
from barc_sim.page.protocol import COLUMNS
from barc_sim.page.rows import FIELDS

if TYPE_CHECKING:
    from barc_sim.page.rows import Sample

STEP = 20_000_000  #: [ns]


class Given(Feed):
    """A feed of given states: distance [m], reception and stamp [ns]."""

    def __init__(self, *states: tuple[float, int, int]) -> None:
        super().__init__()
        self.given = [[state] for state in states]

    def _others(self) -> dict[str, list[Sample]]:
        return {topic: [] for topic in FIELDS}

    def _states(self) -> list[tuple[int, Sample]]:
        return [(at, (stamp, (x, 0.0, 0.0, 8.0, 0.0))) for x, at, stamp in self.given.pop(0)]

    def columns(self) -> dict[str, list[float]]:
        """Return the columns of all rows, by name."""
        rows = b''.join(self.poll() for _ in list(self.given))
        columns = np.frombuffer(rows, '<f8').reshape(-1, len(COLUMNS)).T
        return {name: column.tolist() for name, column in zip(COLUMNS, columns, strict=True)}


def test_a_reset_after_a_pause_leaves_no_gap_and_begins_a_lap() -> None:
    gap = 9 * NANOSECONDS
    states = [
        (60.0, 0, 1),
        (60.16, STEP, 1 + STEP),
        (0.0, gap, gap),
        (0.16, gap + STEP, gap + STEP),
    ]
    columns = Given(*states).columns()
    assert columns['t'] == pytest.approx([0.0, 0.02, 0.04, 0.06])
    assert columns['lap'] == [0.0, 0.0, 1.0, 1.0]


def test_states_that_are_left_out_in_lock_step_are_time_that_has_passed() -> None:
    columns = Given((0.0, 0, 0), (25.6, STEP, 160 * STEP)).columns()
    assert columns['t'] == pytest.approx([0.0, 3.2])
    assert columns['lap'] == [0.0, 0.0]


def test_a_pause_without_a_reset_is_a_step() -> None:
    columns = Given((8.0, 0, 0), (8.16, 5 * NANOSECONDS, STEP)).columns()
    assert columns['t'] == pytest.approx([0.0, 0.02])
