"""The closed loop's score, and what the speed does, stretch by stretch."""

from __future__ import annotations

from typing import TYPE_CHECKING

from user_files import replaced

from barc_sim.errors import UserError
from barc_sim.lab.files import ChosenGains
from barc_sim.lab.judge import Finding, Thresholds
from barc_sim.lab.labs.hills import judge_lab_road

if TYPE_CHECKING:
    from collections.abc import Callable

    from user_files import LocalCode

    Lab = Callable[..., LocalCode]
    Gains = tuple[float, float, float]

RUN = (30.0, 200.0, 0.1)


def judge_drive(code: LocalCode, gains: Gains) -> Finding:
    chosen_gains = ChosenGains(*gains, 'the test')
    try:
        return Finding('loop.lab_road', *judge_lab_road(code, chosen_gains, Thresholds()))
    except UserError as error:
        return Finding('loop.lab_road', 0.0, str(error))


def test_the_message_names_the_worst_stretch(lab: Lab, controller: str) -> None:
    finding = judge_drive(lab(controller=controller), (2.0, 0.0, 0.0))
    assert 0.0 < finding.score < 1.0
    assert finding.message.startswith('RMS error 1.')
    assert 'From 100 m on, at 30°: 2.44 m/s too slow' in finding.message


def test_a_failure_on_the_way_gets_zero(lab: Lab, controller: str) -> None:
    text = controller.replace('dt = 0.02', 'dt = 0.02 if speed_current < 3 else None')
    finding = judge_drive(lab(controller=text), RUN)
    assert finding.score == 0.0
    assert 'TypeError' in finding.message


def test_a_car_that_drives_backwards_has_a_hint(lab: Lab, controller: str) -> None:
    text = replaced(controller, ('max(-8.0, min(8.0, output))', 'output'))
    finding = judge_drive(lab(controller=text), (-50.0, 0.0, 0.0))
    assert finding.score == 0.0
    assert 'the car drives backwards: is the error speed_reference - speed_current?' in (
        finding.message
    )
