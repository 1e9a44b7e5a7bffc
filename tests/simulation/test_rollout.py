"""The loop over many runs: the states of the general loop to the last bit, compiled or not."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from barc_sim.control.speed import PID, PidGains, PidMemory
from barc_sim.simulation.closed_loop import closed_loop
from barc_sim.simulation.metrics import summary
from barc_sim.simulation.rollout import (
    Trace,
    drive_by_pid,
    pid_log,
    run_of,
    scores_of_gains,
    trace_of,
    with_errors,
)
from barc_sim.vehicle.bike_model import Vehicle
from barc_sim.vehicle.law import compiled, is_compiled
from barc_sim.vehicle.plant import Actuator, NoiseLevels, Plant
from barc_sim.vehicle.road import Road

if TYPE_CHECKING:
    from barc_sim.simulation.log import Log

STEPS = 300  #: of a drawn run
needs_numba = pytest.mark.skipif(not is_compiled(), reason='needs the extra fast')


class General(PID):
    """A PID that is driven by the general loop, as any controller of a user's."""


@st.composite
def plants(draw: st.DrawFn) -> Plant:
    """Return a car on a road, with or without noise, delay, lag, limits and a force on it."""
    lengths = draw(st.lists(st.floats(1.0, 30.0), min_size=1, max_size=5))
    grades = draw(st.lists(st.floats(-35.0, 35.0), min_size=len(lengths), max_size=len(lengths)))
    ts = draw(st.sampled_from([0.02, 0.005, 1 / 333]))
    is_dynamic = ts < 0.01 and draw(st.booleans())
    return Plant(
        integrator=draw(st.sampled_from(['euler', 'rk4'])),
        dynamics='dynamic' if is_dynamic else 'kinematic',
        force=draw(st.sampled_from([0.0, -400.0, 250.0])),
        road=Road(tuple(np.cumsum(lengths) - 20.0), tuple(grades)),
        vehicle=Vehicle(
            mass=draw(st.floats(500.0, 5000.0)),
            air_drag_coeff=draw(st.floats(0.0, 5.0)),
            friction=draw(st.floats(0.0, 3000.0)),
        ),
        ts=round(ts * 1e9) / 1e9,
        noise=NoiseLevels(v_x=draw(st.sampled_from([0.0, 0.1]))),
        seed=draw(st.integers(0, 1000)),
        motor=Actuator(
            delay=draw(st.sampled_from([0.0, 0.02, 0.037, 0.2])),
            lag=draw(st.sampled_from([0.0, 0.08])),
            rate=draw(st.sampled_from([float('inf'), 30.0])),
            limit=draw(st.sampled_from([float('inf'), 5.0])),
        ),
    )


gains = st.builds(dict, kp=st.floats(-5.0, 60.0), ki=st.floats(0.0, 300.0), kd=st.floats(0.0, 1.0))


def columns(log: Log) -> list[bytes]:
    return [column.tobytes() for column in log.columns().values()]


@settings(max_examples=100)
@given(plant=plants(), values=gains, reference=st.floats(-3.0, 12.0))
def test_the_log_of_a_rollout_is_that_of_the_general_loop(
    plant: Plant, values: dict[str, float], reference: float
) -> None:
    limits = {'output_min': -8.0, 'output_max': 8.0}
    assert plant.has_fast_path
    log = pid_log(plant, PID(**values, **limits), reference, 40.0, STEPS)
    expected = closed_loop(
        plant,
        General(**values, **limits),
        speed_reference=reference,
        distance=40.0,
        max_duration=STEPS * plant.ts,
    )

    assert columns(log) == columns(expected)


def states(plant: Plant, values: dict[str, float], *, is_array: bool) -> Trace:
    """Return the states of a run, of a compiled loop if they are arrays."""
    errors = plant.sensor.errors(STEPS) if plant.sensor.is_noisy else np.empty((0, 6))
    run = run_of(plant, 8.0, 40.0, is_array=is_array)
    run = with_errors(run, errors[:, 3].copy())
    trace = trace_of(run, STEPS, is_array=is_array)
    loop = compiled(drive_by_pid) if is_array else drive_by_pid
    loop(run, PidGains(**values, output_min=-8.0, output_max=8.0), PidMemory(), trace)
    return trace


@needs_numba
@settings(max_examples=200)
@given(plant=plants(), values=gains)
def test_the_states_of_compiled_code_are_those_of_python(
    plant: Plant, values: dict[str, float]
) -> None:
    compiled_states = states(plant, values, is_array=True)
    expected = states(plant, values, is_array=False)
    assert [np.asarray(column, np.float64).tobytes() for column in compiled_states] == [
        np.array(column, np.float64).tobytes() for column in expected
    ]


@pytest.mark.parametrize(
    'options',
    [
        {},
        {'noise': NoiseLevels(v_x=0.05), 'seed': 3, 'motor': Actuator(delay=0.05, lag=0.1)},
        {'road': Road((0.0, 20.0, 40.0), (5.0, 5.0, -3.0))},
    ],
)
def test_the_scores_are_those_of_the_summary(options: dict[str, Any]) -> None:
    swept = np.array([[10.0, 20.0, 0.0], [30.0, 200.0, 0.1], [0.0, 0.0, 0.0]])
    scores = scores_of_gains(Plant(**options), swept, 8.0, 8.0, 60.0, 1500)
    for row, (kp, ki, kd) in zip(scores[:2], swept[:2], strict=True):
        pid = PID(kp, ki, kd, output_min=-8.0, output_max=8.0)
        log = closed_loop(Plant(**options), pid, distance=60.0)
        expected = summary(log)
        assert row.tolist() == pytest.approx(
            [
                expected.rms_error_after_run_up,
                expected.max_error_after_run_up,
                expected.overshoot,
                np.sqrt(np.mean(log.motor**2)),
            ]
        )

    assert np.isinf(scores[2]).all()  # it never arrives


def test_many_gains_are_those_of_each_alone() -> None:
    swept = np.column_stack([np.linspace(5.0, 60.0, 9), np.full(9, 50.0), np.zeros(9)])
    alone = [scores_of_gains(Plant(), each[None], 8.0, 8.0, 30.0, 600)[0] for each in swept]
    together = scores_of_gains(Plant(), swept, 8.0, 8.0, 30.0, 600)
    assert together.tolist() == np.array(alone).tolist()
