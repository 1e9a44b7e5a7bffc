"""Recorded commands through a model."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from barc_sim.control.driver import DriverInput
from barc_sim.lab.regrade import states
from barc_sim.lab.user_code.loading import UserCodeError
from barc_sim.simulation.closed_loop import closed_loop, drive_by_hand
from barc_sim.vehicle.actuators import Actuator
from barc_sim.vehicle.bike_model import Command, Motion, State, bikeFE
from barc_sim.vehicle.plant import Plant
from barc_sim.vehicle.road import Road
from barc_sim.vehicle.sensor import NoiseLevels

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from barc_sim.simulation.log import Log

NOISE = NoiseLevels(0.1, 0.1, 0.01, 0.2, 0.1, 0.05)


def judge(log: Log, new: Any = Plant, **options: Any) -> states.Verdict:  # noqa: ANN401
    return states.judge(log, new, 'barc_sim', **options)[0]


def part(log: Log, rows: Sequence[int]) -> Log:
    return log.map(lambda column: column[list(rows)])


def driven(log: Log, advance: Callable[[Plant, int], object], plant: Plant | None = None) -> Log:
    """Return the log with the states that `advance` gives a plant at each step."""
    plant, rows = plant or Plant(), []
    for k in range(len(log)):
        rows.append(plant.observe().measured)
        advance(plant, k)
    return replace(log, **dict(zip(Motion._fields, np.array(rows).T, strict=True)))


def command(log: Log, k: int) -> Command:
    return Command(log.motor[k].item(), log.servo[k].item())


def test_a_run_of_the_model_is_its_bit_for_bit() -> None:
    log = closed_loop()
    verdict = judge(log)
    assert verdict.possible
    assert verdict.exact == verdict.values == len(log)


def test_noise_of_the_same_seed_comes_out_bit_for_bit() -> None:
    new = partial(Plant, noise=NOISE, seed=3)
    verdict = judge(closed_loop(new(), distance=30.0), new)
    assert verdict.exact == verdict.values


def test_noise_of_another_seed_is_subtracted() -> None:
    log = closed_loop(Plant(noise=NOISE, seed=3), distance=30.0)
    verdict = judge(log, partial(Plant, noise=NOISE, seed=4))
    assert verdict.possible
    assert verdict.exact < verdict.values
    assert 0.0 < verdict.greatest < 1e-12


@pytest.mark.parametrize('name', Motion._fields)
def test_a_changed_state_is_named(name: str) -> None:
    log = closed_loop(distance=30.0)
    column = getattr(log, name).copy()
    column[40] += 1e-6
    verdict = judge(replace(log, **{name: column}))
    assert not verdict.possible
    assert f'(state 40) {name} is ' in verdict.first


def test_a_changed_command_is_seen_in_the_next_state() -> None:
    log = closed_loop(distance=30.0)
    motor = log.motor.copy()
    motor[40] += 1e-6
    verdict = judge(replace(log, motor=motor))
    assert not verdict.possible
    assert '(state 41) v_x is ' in verdict.first
    assert verdict.deviating == 1


def test_a_delay_set_during_the_run_is_asked_about() -> None:
    class Retuned(Plant):
        def advance(self, command: Command | None = None) -> None:
            if 7.0 < self.state.x < 8.0:
                self.retune(NoiseLevels(), Actuator(delay=0.1), Actuator())
            super().advance(command)

    verdict = judge(closed_loop(Retuned(), distance=30.0))
    assert not verdict.possible
    assert verdict.first.endswith('were parameters of the car changed during the run?')


def test_another_model_is_not_it() -> None:
    def model(*row: float, **vehicle: float) -> list[float]:
        x, y, psi, v = bikeFE(*row, **vehicle)
        return [x, y, psi, v + 1e-4]

    verdict = judge(closed_loop(distance=30.0), partial(Plant, model=model))
    assert not verdict.possible
    assert verdict.deviating == verdict.values - 1


def test_a_model_that_fails_is_not_it() -> None:
    def model(*_: float, **__: float) -> list[float]:
        raise UserCodeError('line 3: wrong')

    assert judge(closed_loop(distance=1.0), partial(Plant, model=model)).first == 'line 3: wrong'


def test_where_a_deadline_was_missed_the_last_command_held() -> None:
    log = part(closed_loop(distance=30.0), range(60))
    missed = np.isin(np.arange(60), [50, 51, 55])
    held = driven(log, lambda plant, k: plant.advance(None if missed[k] else command(log, k)))
    assert judge(replace(held, missed=missed)).exact == 60
    assert not judge(held).possible


def test_a_drive_by_hand_is_followed_whichever_command_held() -> None:
    requests = [
        (0.0, DriverInput(forward=1.0)),
        (0.4, DriverInput(forward=1.0, turn=1.0)),
        (0.8, DriverInput()),
    ]
    log = drive_by_hand(requests, 2.0)
    # Published close to a deadline, a command may be recorded with the state before.
    motor, servo = np.roll(log.motor, -1), np.roll(log.servo, -1)
    flat = partial(Plant, road=Road.flat())
    assert judge(log, flat).possible
    assert judge(replace(log, motor=motor, servo=servo), flat).possible
    assert not judge(replace(log, motor=motor + 0.1), flat).possible


def test_braking_by_the_simulator_itself_is_followed() -> None:
    log = drive_by_hand([(0.0, DriverInput(forward=1.0))], 1.0)
    flat = partial(Plant, road=Road.flat())

    def advance(plant: Plant, k: int) -> None:
        plant.advance(command(log, k)) if k < 20 else plant.brake(8.0)

    log = driven(log, advance, flat())
    assert judge(log, flat, braking=8.0).possible
    assert not judge(log, flat).possible


def test_a_car_that_began_anew_is_followed() -> None:
    log = closed_loop(distance=10.0)
    n = len(log)
    twice = part(log, [*range(n), *range(n)])
    twice = replace(twice, t=np.arange(2 * n) * 0.02)
    verdict, resets = states.judge(twice, Plant, 'barc_sim')
    assert verdict.exact == 2 * n
    assert resets == {n}


def test_a_car_that_was_put_elsewhere_is_followed_where_somebody_asked_for_it() -> None:
    place = State(50.0, 1.0, 0.1, 0.0)
    log = part(closed_loop(distance=10.0), range(40))
    log = driven(
        log, lambda plant, k: plant.place(place) if k == 20 else plant.advance(command(log, k))
    )
    verdict = judge(log, placements=1)
    assert verdict.possible
    assert verdict.placements == 1
    assert not judge(log).possible


def test_what_follows_a_gap_is_taken_as_it_is() -> None:
    log = closed_loop(distance=30.0)
    verdict = judge(part(log, [*range(50), *range(60, len(log))]))
    assert verdict.possible
    assert verdict.gaps == 1


def test_a_bag_that_begins_later_is_followed_from_there() -> None:
    verdict = judge(part(closed_loop(distance=30.0), range(50, 100)))
    assert verdict.possible
    assert verdict.gaps == 1
    assert verdict.values == 49


def test_errors_that_a_killed_run_has_not_told_count_as_none() -> None:
    log = closed_loop(distance=10.0)
    unknown = log.e_v_x.copy()
    unknown[-5:] = np.nan
    assert judge(replace(log, e_v_x=unknown)).possible
