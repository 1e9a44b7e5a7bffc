"""A submission's functions, called in another process."""

from __future__ import annotations

from random import Random
from typing import TYPE_CHECKING

import pytest
from user_files import CONTROLLER, MODEL

from barc_sim.control.speed import PID
from barc_sim.errors import UserError
from barc_sim.lab.confined.process import Limits
from barc_sim.lab.labs.pid import HillsCode
from barc_sim.vehicle.bike_model import bikeFE

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

pytestmark = pytest.mark.usefixtures('confinement')

_RANDOM = Random(6)  # noqa: S311 (a simulation)
ROWS = [[_RANDOM.uniform(0.1, 1.0) for _ in range(11)] for _ in range(3_000)]
SAMPLES = [(8.0, _RANDOM.uniform(0.0, 9.0), 0.02) for _ in range(500)]
QUICK = Limits(call=0.3)
PID_LOOPING_AT_5 = """
class PID:
    def __init__(self, kp, ki, kd):
        pass
    def acc_calculate(self, speed_reference, speed_current):
        while speed_current == 5.0:
            pass
        if speed_current == 6.0:
            import ctypes
            ctypes.string_at(0)
        return 1.0
"""


def test_the_model_gives_the_same_as_in_this_process(folder: Callable[..., Path]) -> None:
    with HillsCode(folder(bike_model=MODEL)) as code:
        assert code.bike_fe(ROWS) == [tuple(bikeFE(*row)) for row in ROWS]
        assert code.bike_fe(ROWS[:1], l_f=1.2, l_r=1.9) == [
            tuple(bikeFE(*ROWS[0], l_f=1.2, l_r=1.9))
        ]


def test_a_controller_gives_the_same_as_in_this_process(folder: Callable[..., Path]) -> None:
    here = PID(3.0, 2.0, 0.1, output_min=-8.0, output_max=8.0)
    with HillsCode(folder(controller=CONTROLLER)) as code:
        there = code.new_pid(3.0, 2.0, 0.1, limit=8.0)
        expected = [here.acc_calculate(*sample) for sample in SAMPLES]
        assert there.acc_sequence(SAMPLES) == expected
        assert there.reset()
        assert there.acc_calculate(*SAMPLES[0]) == expected[0]


def test_an_infinity_that_is_forged_is_refused(folder: Callable[..., Path]) -> None:
    text = """
import os
def bikeFE(x, y, psi, v, a, d_f, a0, m, Ff, theta, ts):
    frame = b'{"serial": 1, "result": [[Infinity, 0.0, 0.0, 0.0]]}\\n'
    for i in range(3, 64):
        try:
            os.write(i, frame)
        except OSError:
            pass
    while True:
        pass
"""
    with (
        HillsCode(folder(bike_model=text), QUICK) as code,
        pytest.raises(UserError, match='not finite'),
    ):
        code.bike_fe(ROWS[:1])


def test_a_call_after_one_that_ended_the_process_is_answered(folder: Callable[..., Path]) -> None:
    with HillsCode(folder(controller=PID_LOOPING_AT_5), QUICK) as code:
        stuck = code.new_pid(1.0, 1.0, 1.0)
        with pytest.raises(UserError, match=r'line 6: acc_calculate.* not return within 0.3 s'):
            stuck.acc_calculate(8.0, 5.0, 0.02)
        with pytest.raises(UserError, match=r'crashed'):
            stuck.acc_calculate(8.0, 6.0, 0.02)

        with pytest.raises(UserError, match='the process of this controller has ended'):
            stuck.acc_calculate(8.0, 4.0, 0.02)
        assert code.new_pid(1.0, 1.0, 1.0).acc_calculate(8.0, 4.0, 0.02) == 1.0


def test_a_function_that_keeps_ending_its_process_is_not_called_again(
    folder: Callable[..., Path],
) -> None:
    text = 'import os\nprint("called")\nos._exit(3)\n'
    with HillsCode(folder(bike_model=text, controller=CONTROLLER)) as code:
        for _ in range(5):
            with pytest.raises(UserError, match='ended itself with exit code 3'):
                code.bike_fe(ROWS[:1])

        assert code.printed.count('called') == 2
        assert code.new_pid(1.0, 0.0, 0.0).acc_calculate(8.0, 7.0, 0.02) == 1.0


def test_the_beginning_of_what_is_printed_is_kept(folder: Callable[..., Path]) -> None:
    text = 'print("first")\nprint("x" * 10_000)\nraise ValueError\n'
    with HillsCode(folder(bike_model=text), Limits(output=100)) as code:
        with pytest.raises(UserError, match='ValueError'):
            code.bike_fe(ROWS[:1])
        code.close()

        assert code.printed == f'first\n{"x" * 94}\n[and more]'


@pytest.mark.parametrize(
    'forged',
    [
        "notes = lambda self: {'gains': [1, 2, 3, 'x' * 10**6], 'tolerated': ['y' * 10**6] * 10}",
        'notes = lambda self: 10**4000',
        'relay_commands = lambda self, *_: [[0.1, 0.2, 0.3]] * 10**5',
        "relay_commands = lambda self, *_: [[0, 'x', None]]",
        "relay_commands = lambda self, *_: {'x': 1}",
    ],
)
def test_forged_answers_of_any_shape_and_size_are_sentences(
    folder: Callable[..., Path], forged: str
) -> None:
    patch = f"import sys\nsys.modules['barc_sim.lab.user_code.code'].UserCode.{forged}\n"
    text = f'{patch}def relay(x, z): return [x, z]\n'
    with HillsCode(folder(relay=text, bike_model=patch + MODEL)) as code:
        code.bike_fe(ROWS[:1])
        if 'relay' in forged:
            with pytest.raises(UserError, match='relay'):
                code.relay_commands([], 1.0)

        assert len(str(code.chosen_gains())) < 500
        assert sum(map(len, code.tolerated())) < 10_000
