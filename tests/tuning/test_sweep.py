"""Sweeps over gains for a notebook."""

from __future__ import annotations

import numpy as np
import pytest

from barc_sim.errors import UserError
from barc_sim.simulation.closed_loop import simulate
from barc_sim.simulation.metrics import summary
from barc_sim.tuning.goal import sweep


@pytest.mark.parametrize('options', [{}, {'noise': 0.05, 'seed': 2, 'delay': 0.04}])
def test_a_sweep_scores_the_runs_of_simulate(options: dict[str, float]) -> None:
    found = sweep([10.0, 30.0], ki=100.0, distance=60.0, **options)
    for each in found:
        log = simulate(each.kp, each.ki, each.kd, distance=60.0, **options)
        expected = summary(log)
        assert each.rms_error == pytest.approx(expected.rms_error_after_run_up)
        assert each.max_error == pytest.approx(expected.max_error_after_run_up)
        assert each.overshoot == pytest.approx(expected.overshoot)
        assert each.effort == pytest.approx(np.sqrt(np.mean(log.motor**2)))


def test_gains_are_broadcast_and_the_best_is_found_by_name() -> None:
    kp, ki = np.linspace(0.0, 60.0, 20), np.linspace(0.0, 400.0, 10)
    found = sweep(kp[:, np.newaxis], ki, 0.0, distance=40.0)
    assert found.shape == (20, 10)
    assert np.isinf(found.rms_error[0, 0])
    best = found.flat[found.rms_error.argmin()]
    assert (best.kp, best.ki) == (60.0, 400.0)
    assert best.rms_error == found.rms_error.min()


def test_a_delay_that_is_no_multiple_of_the_step_is_refused() -> None:
    with pytest.raises(UserError, match=r'delay 0.03 s must be a multiple of the step, 0.02 s'):
        sweep(delay=0.03)
