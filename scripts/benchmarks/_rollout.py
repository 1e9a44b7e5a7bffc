"""One measurement of closed loops: its task is JSON on the command line, and so are its figures."""

from __future__ import annotations

import json
import sys
import time
from contextlib import ExitStack
from typing import TYPE_CHECKING, Any
from unittest.mock import patch

import numpy as np
from numpy import arctan, cos, float64, sin, tan

from barc_sim.control.lane import LaneLQR, PurePursuit, Stanley
from barc_sim.control.speed import KD, KP, LQR
from barc_sim.simulation import law_runs, many_runs, rollout
from barc_sim.simulation.closed_loop import simulate
from barc_sim.simulation.scenario import Scenario
from barc_sim.tuning.sweep import sweep
from barc_sim.vehicle.road import Road

if TYPE_CHECKING:
    from collections.abc import Callable

_RUNS = 100_000  #: that `sweep` scores at a time
_RUNS_OF_LAWS = 10_000  #: of the LQR, and of laps
_RUNS_IN_PYTHON = 100
_SEEDS = 5000
#: Two laps and a half.
_LAPS: dict[str, Any] = {'track': 'oval', 'distance': 564.0, 'speed_reference': 6.0}
_LANES = {'laps': LaneLQR(), 'stanley': Stanley(), 'pure pursuit': PurePursuit()}


class LabPid:
    """The PID as students of the lab write it."""

    def __init__(self, kp: float, ki: float, kd: float) -> None:
        self.kp = kp
        self.ki = ki
        self.kd = kd
        self.integral = 0.0
        self.previous = 0.0

    def acc_calculate(self, reference: float, speed: float64) -> float64:
        """Return the command."""
        error = reference - speed
        self.integral += error * 0.02
        derivative = (error - self.previous) / 0.02
        self.previous = error

        total = self.kp * error + self.ki * self.integral + self.kd * derivative
        command: float64 = min(max(total, float64(-8.0)), float64(8.0))
        return command


def lab_bike_fe(
    x: float64,
    y: float64,
    psi: float64,
    v: float64,
    a: float64,
    d_f: float64,
    theta: float64,
) -> tuple[float64, float64, float64, float64]:
    """Return the next state, with NumPy's functions for single numbers."""
    a0 = 0.01308
    m = 2000.0
    friction = 0.01711
    ts = 0.02
    l_f = 1.5
    l_r = 1.5

    beta = arctan(l_r / (l_f + l_r) * tan(d_f))
    external = -m * 9.8 * sin(theta) - a0 * v**2 - friction
    return (
        x + ts * v * cos(psi + beta),
        y + ts * v * sin(psi + beta),
        psi + ts * v / l_r * sin(beta),
        v + ts * (a + external / m),
    )


def lab_loop() -> int:
    """Drive 180 m the lab's way; return the steps."""
    pid = LabPid(KP, 20.0, KD)
    road = Road.lab()
    x = y = psi = v = float64(0.0)
    steps = 0
    while x < Scenario.distance:
        theta = np.radians(road.grade_deg(x))
        motor = pid.acc_calculate(8.0, v)
        x, y, psi, v = lab_bike_fe(x, y, psi, v, motor, float64(0.0), theta)
        steps += 1
    return steps


def simulate_loop() -> int:
    """Drive `simulate`, with its whole log."""
    return len(simulate()) - 1


def noise_loop() -> int:
    """Drive `simulate` with noise."""
    return len(simulate(noise=0.1)) - 1


def sweep_loop(runs: int = _RUNS) -> int:
    """Score the same gains many times; return the steps."""
    sweep(np.full(runs, KP))
    return runs * simulate_loop()


def lqr_loop(runs: int = _RUNS_OF_LAWS) -> int:
    """Score the same weights of the LQR many times; return the steps."""
    sweep(controller=LQR(), speed_weight=np.full(runs, 400.0))
    return runs * (len(simulate(controller=LQR())) - 1)


def laps_loop(runs: int = _RUNS_OF_LAWS, lane: str = 'laps', **options: Any) -> int:  # noqa: ANN401
    """Score the same laps many times, with one law of steering; return the steps."""
    sweep(np.full(runs, KP), lane=_LANES[lane], **_LAPS, **options)
    return runs * (len(simulate(lane=_LANES[lane], **_LAPS)) - 1)


def in_one_thread(loop: Callable[[], int]) -> int:
    """Score runs on one core; return the steps."""
    with patch.object(many_runs, 'cpu_count', lambda: 1):
        return loop()


def in_python(loop: Callable[[int], int]) -> int:
    """Score some of the runs without Numba; return the steps."""
    with ExitStack() as stack:
        for module in (law_runs, many_runs, rollout):
            stack.enter_context(patch.object(module, 'is_compiled', lambda: False))
        for module in (law_runs, rollout):
            stack.enter_context(patch.object(module, 'compiled', _not_compiled))
        return loop(_RUNS_IN_PYTHON)


def _not_compiled(function: Callable[..., Any]) -> Callable[..., Any]:
    return function


def seeds_loop() -> int:
    """Score runs that differ in their noise; return the steps."""
    sweep(noise=0.1, seed=range(_SEEDS))
    return _SEEDS * noise_loop()


#: Each drives once, and returns the steps.
_LOOPS: dict[str, Callable[[], int]] = {
    'lab': lab_loop,
    'simulate': simulate_loop,
    'noise': noise_loop,
    'sweep': sweep_loop,
    'one thread': lambda: in_one_thread(sweep_loop),
    'python': lambda: in_python(sweep_loop),
    'seeds': seeds_loop,
    'lqr': lqr_loop,
    'lqr python': lambda: in_python(lqr_loop),
    'laps': laps_loop,
    'laps one thread': lambda: in_one_thread(laps_loop),
    'laps python': lambda: in_python(laps_loop),
    'stanley': lambda: laps_loop(lane='stanley'),
    'pure pursuit': lambda: laps_loop(lane='pure pursuit'),
    'laps seeds': lambda: laps_loop(_SEEDS, noise=0.05, seed=range(_SEEDS)),
}


def _rates(loop: Callable[[], int], seconds: float) -> dict[str, float]:
    loop()  # to warm up

    steps = 0
    start = time.perf_counter()
    processor_start = time.process_time()
    while time.perf_counter() - start < seconds:
        steps += loop()

    wall = time.perf_counter() - start
    processor = time.process_time() - processor_start
    return {'steps/s': steps / wall, 'steps/s of processor time': steps / processor}


if __name__ == '__main__':
    task = json.loads(sys.argv[1])
    print(json.dumps(_rates(_LOOPS[task['subject']], task['seconds'])))
