"""Nothing that computes the answers is within reach of a submission."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest
from relays import ROS_2
from user_files import user_text

from barc_sim.lab.confined.process import JudgedCode, ProcessLimits
from barc_sim.lab.grade.grade import grade, load_rubric
from barc_sim.lab.labs.relay import relay_commands
from barc_sim.lab.submission import read_submission

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

pytestmark = pytest.mark.usefixtures('confinement')

#: Prints each module, open file and folder of barc_sim that could have the answers.
LOOK = user_text('look_for_answers.py')
#: Each gives the answers to whoever can run it.
GRABS = (
    "import sys; bikeFE = sys.modules['barc_sim.vehicle.bike_model'].bikeFE",
    "import sys; bikeFE = sys.modules['barc_sim'].Vehicle; bikeFE(1)",
    'from barc_sim.vehicle.bike_model import bikeFE; 1.0 + bikeFE',
    "import importlib\nbikeFE = importlib.import_module('barc_sim.vehicle.bike_model').bikeFE",
    (
        'import importlib, sys\nfor m in [*sys.modules.values()]:\n'
        " if getattr(m, '__file__', None) and 'barc_sim' in m.__file__:\n"
        "  sys.path.append(m.__file__.partition('/barc_sim/lab')[0])\n"
        "sys.modules['barc_sim'].__path__ = [sys.path[-1] + '/barc_sim']\n"
        "bikeFE = importlib.import_module('barc_sim.vehicle.bike_model').bikeFE"
    ),
    'import os\nbikeFE = open(f"/proc/{os.getppid()}/mem", "rb").read',
)


def test_no_module_in_reach_has_the_answers(folder: Callable[..., Path]) -> None:
    with JudgedCode(folder(bike_model=LOOK, relay=ROS_2)) as code:
        relay_commands(code, [], 1.0)
        code.rows('bikeFE', [[0.0] * 11])
    assert code.printed.splitlines() == ['[]'] * 4


def test_code_that_looks_for_barc_sims_model_gets_no_points(folder: Callable[..., Path]) -> None:
    tries = '\n'.join(
        f'try:\n    exec({code!r})\n    print("grabbed")\nexcept BaseException as error:\n'
        '    print(type(error))'
        for code in GRABS
    )

    graded = grade(read_submission(folder(bike_model=tries)), load_rubric(), ProcessLimits())

    assert graded.score == 0.0
    assert graded.printed.count('Error') == len(GRABS)
    assert 'grabbed' not in graded.printed
