"""Recorded speeds through a controller."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from barc_sim.control.pid import speed_controller
from barc_sim.lab.regrade import commands
from barc_sim.lab.user_code.loading import UserCodeError
from barc_sim.simulation.closed_loop import closed_loop
from barc_sim.vehicle.plant import Plant
from barc_sim.vehicle.sensor import NoiseLevels

judge = partial(commands.judge, code='barc_sim', limit=8.0)


def test_the_commands_of_a_run_come_out_bit_for_bit() -> None:
    verdict = judge(closed_loop(), speed_controller)
    assert verdict.possible
    assert verdict.exact == verdict.values == len(closed_loop())


@pytest.mark.parametrize('gains', [(30.0, 200.0, 0.2), (30.1, 200.0, 0.1), (30.0, 0.0, 0.1)])
def test_other_gains_are_not_it(gains: tuple[float, float, float]) -> None:
    verdict = judge(closed_loop(), partial(speed_controller, *gains))
    assert not verdict.possible
    assert 'were gains changed during the run?' in verdict.first


def test_the_measured_speed_is_what_a_controller_is_shown() -> None:
    log = closed_loop(Plant(noise=NoiseLevels(v_x=0.1)))
    assert judge(log, speed_controller).exact == len(log)
    assert not judge(log, speed_controller, subtract_error=True).possible


def test_a_controller_begins_anew_with_the_car() -> None:
    log = closed_loop(distance=30.0)
    n = len(log)
    both = log.map(lambda column: np.tile(column, 2))
    both = replace(both, t=np.arange(2 * n) * 0.02)
    assert judge(both, speed_controller, resets={n}).exact == 2 * n
    assert not judge(both, speed_controller).possible


def test_states_without_a_command_are_passed_over() -> None:
    log = closed_loop(distance=30.0)
    motor = log.motor.copy()
    motor[-1] = np.nan
    verdict = judge(replace(log, motor=motor), speed_controller)
    assert verdict.exact == len(log) - 1


def test_a_controller_that_fails_is_not_it() -> None:
    class Failing:
        def acc_calculate(self, *_: float) -> float:
            raise UserCodeError('line 7: wrong')

    assert judge(closed_loop(distance=1.0), Failing).first == 'line 7: wrong'


def test_commands_beyond_the_limit_are_cut() -> None:
    class Strong:
        def acc_calculate(self, *_: float) -> float:
            return 99.0

    log = closed_loop(distance=1.0)
    assert judge(replace(log, motor=np.full(len(log), 8.0)), Strong).possible
