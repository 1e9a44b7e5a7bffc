"""Laps: where one begins, and what is known of each."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from barc_sim.control.pid import PID
from barc_sim.page.facts import lap_facts, stretch_facts
from barc_sim.simulation import metrics
from barc_sim.simulation.closed_loop import closed_loop
from barc_sim.simulation.laps import Laps, laps_of
from barc_sim.simulation.log import Log


def joined(*logs: Log, pause: float = 0.0) -> Log:
    """Return a run that begins anew between the logs, after a pause [s]."""
    shifts = np.cumsum([0.0, *(log.t[-1] + 0.02 + pause for log in logs[:-1])])
    parts = [replace(log, t=log.t + shift) for log, shift in zip(logs, shifts, strict=True)]
    columns = [part.columns() for part in parts]
    return Log(**{name: np.concatenate([c[name] for c in columns]) for name in columns[0]})


def test_each_lap_has_the_figures_of_a_run_of_its_own() -> None:
    weak = closed_loop(controller=PID(4.0, 0.0, 0.0, output_min=-8.0, output_max=8.0))
    tuned = closed_loop()
    laps, numbers = laps_of(joined(tuned, weak, tuned))
    assert numbers == [0] * len(tuned) + [1] * len(weak) + [2] * len(tuned)
    facts = lap_facts(laps)
    assert facts['count'] == 3
    for name, log, number in (('current', tuned, 2), ('last', weak, 1), ('best', tuned, 0)):
        summary = metrics.summary(log)
        assert facts[name]['number'] == number
        assert facts[name]['rms'] == pytest.approx(summary.rms_error_after_run_up)
        assert facts[name]['greatest'] == pytest.approx(summary.max_error_after_run_up)
        assert facts[name]['overshoot'] == pytest.approx(summary.overshoot)
    assert [stretch['theta_deg'] for stretch in stretch_facts(laps.current)][:2] == [0.0, 10.0]


def test_fast_car_without_a_reset_drives_one_lap() -> None:
    laps = Laps()
    numbers = {laps.add(0.02 * k, 2.0 * k, 0.0, 100.0, 8.0, 0.0) for k in range(100)}
    assert numbers == {0}


def test_short_lap_is_not_the_best() -> None:
    tuned = closed_loop()
    short = closed_loop(distance=15.0)
    weak = closed_loop(controller=PID(4.0, 0.0, 0.0, output_min=-8.0, output_max=8.0))
    laps, _ = laps_of(joined(weak, short, tuned))
    assert lap_facts(laps)['best']['number'] == 0


def test_reset_after_a_long_pause_begins_a_lap() -> None:
    laps = Laps()
    assert laps.add(0.0, 0.0, 0.0, 0.0, 8.0, 0.0) == 0
    assert laps.add(4.0, 32.0, 0.0, 8.0, 8.0, 10.0) == 0
    assert laps.add(64.0, 0.0, 0.0, 0.0, 8.0, 0.0) == 1


def test_every_lap_has_its_row_also_one_that_was_cut_short() -> None:
    laps, _ = laps_of(joined(closed_loop(), closed_loop(distance=15.0), closed_loop()))
    assert [round(lap.end_distance) for lap in laps] == [180, 15, 180]
    assert [lap.number for lap in laps] == [0, 1, 2]
