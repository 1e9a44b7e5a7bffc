"""Objects with the lab's `acc_calculate` as controllers."""

from __future__ import annotations

from typing import Any

import pytest

from barc_sim.control.controller import Gain
from barc_sim.control.lqr import LQR
from barc_sim.control.pid import PID
from barc_sim.control.types import as_controller
from barc_sim.errors import UserError
from barc_sim.simulation.closed_loop import closed_loop


class Lab:
    """The lab's controller, as its template has it."""

    def __init__(self, kp: float = 10.0, ki: float = 0.5) -> None:
        self.kp = kp
        self.ki = ki
        self.int_error = 0.0

    def acc_calculate(self, speed_reference: float, speed_current: float) -> float:
        """Return the acceleration [m/s²]."""
        error = speed_reference - speed_current
        self.int_error += error
        return self.kp * error + self.ki * self.int_error


class WithDt(Lab):
    """One that takes dt by its name."""

    def acc_calculate(self, reference: float, current: float, dt: float) -> float:  # type: ignore[override]
        """Return the acceleration [m/s²], and keep the interval."""
        self.seen = dt
        return super().acc_calculate(reference, current)


class WithStep(Lab):
    """One that takes dt by another name."""

    def acc_calculate(self, reference: float, current: float, step: float) -> float:  # type: ignore[override]
        """Return the acceleration [m/s²], and keep the interval."""
        self.integral = step
        return super().acc_calculate(reference, current)


@pytest.mark.parametrize('controller', [PID(), LQR()])
def test_a_whole_controller_is_taken_as_it_is(controller: PID | LQR) -> None:
    assert as_controller(controller) is controller


@pytest.mark.parametrize('kind', [Lab, WithDt, WithStep])
def test_two_arguments_or_three_give_the_same_run(kind: type[Lab]) -> None:
    log = closed_loop(controller=as_controller(kind()), distance=30.0)
    assert log.distance[-1] >= 30.0
    assert (log.motor == closed_loop(controller=as_controller(Lab()), distance=30.0).motor).all()


def test_the_object_itself_stays_as_it_was() -> None:
    mine = Lab()
    adapted = as_controller(mine)
    first = [adapted.acc_calculate(8.0, 7.0, 0.02) for _ in range(3)]
    adapted.reset()
    assert [adapted.acc_calculate(8.0, 7.0, 0.02) for _ in range(3)] == first
    assert mine.int_error == 0.0


def test_gains_are_those_that_the_object_has_and_can_be_set() -> None:
    adapted: Any = as_controller(Lab())
    assert [*adapted.gains] == ['kp', 'ki']
    assert adapted.kp == 10.0
    adapted.acc_calculate(8.0, 7.0, 0.02)
    adapted.kp = 20.0
    assert adapted.acc_calculate(8.0, 7.0, 0.02) == 21.0


def test_output_is_limited_and_terms_are_the_objects() -> None:
    adapted: Any = as_controller(WithStep())
    adapted.output_min, adapted.output_max = -2.0, 2.0
    assert adapted.acc_calculate(8.0, 0.0, 0.02) == 2.0
    assert adapted.saturated
    assert adapted.integral == 0.02
    assert adapted.derivative != adapted.derivative


def test_an_object_may_declare_its_own_gains_and_terms() -> None:
    class Own:
        gains = {'gain': Gain(2.0, '1/s', 'the gain', 10.0)}  # noqa: RUF012
        terms = {'pull': 'toward the reference'}  # noqa: RUF012
        gain = 3.0

        def acc_calculate(self, reference: float, current: float) -> float:
            self.pull = self.gain * (reference - current)
            return self.pull

    log = closed_loop(controller=as_controller(Own()), distance=10.0)
    assert [*log.terms] == ['pull']
    assert (log.terms['pull'] == log.motor).all()


@pytest.mark.parametrize(
    ('wrong', 'message'),
    [
        (PID, r'controller=PID is a class; expected an object, such as PID\('),
        (Lab, r'controller=Lab is a class; expected an object, such as Lab\('),
        (3.0, r'controller=3\.0 has no method acc_calculate\(speed_reference, speed_current\)'),
        (
            type('One', (), {'acc_calculate': lambda self, error: error})(),  # noqa: ARG005
            r'acc_calculate takes \(error\): expected \(speed_reference, speed_current\)',
        ),
    ],
)
def test_what_is_no_controller_is_refused(wrong: object, message: str) -> None:
    with pytest.raises(UserError, match=message):
        as_controller(wrong)
