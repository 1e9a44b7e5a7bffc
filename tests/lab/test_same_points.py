"""The same file has the same results each time, whatever random numbers it uses."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from barc_sim.lab.confined.process import JudgedCode

if TYPE_CHECKING:
    from pathlib import Path

FILE = """\
import random
import time
import uuid
import numpy as np

def command(t):
    return {}
"""
#: Random numbers without a seed, or with one that differs each time.
RANDOM = [
    'random.random()',
    'random.Random().random()',
    'random.SystemRandom().random()',
    '(random.seed(), random.random())[1]',
    '(random.seed(a=None), random.random())[1]',
    'random.Random(time.time()).random()',
    'random.Random(time.time_ns()).random()',
    'uuid.uuid4().int / 2**128',
    'np.random.rand()',
    '(np.random.seed(), np.random.rand())[1]',
    'np.random.RandomState().rand()',
    'np.random.default_rng().random()',
    'np.random.Generator(np.random.PCG64()).random()',
]


def commands_of(folder: Path) -> list[tuple[float]]:
    """Return the commands of a file in a new process."""
    with JudgedCode(folder) as code:
        return code.rows('command', [[0.0]] * 4)


@pytest.mark.usefixtures('confinement')
@pytest.mark.parametrize('expression', RANDOM)
def test_random_numbers_are_the_same_in_each_process(tmp_path: Path, expression: str) -> None:
    (tmp_path / 'identify.py').write_text(FILE.format(expression), encoding='utf-8')
    commands = commands_of(tmp_path)
    assert commands_of(tmp_path) == commands
    assert len({*commands}) == len(commands)


@pytest.mark.usefixtures('confinement')
def test_a_seed_of_the_file_counts(tmp_path: Path) -> None:
    text = FILE.format('random.Random(5).random() + np.random.default_rng(5).random()')
    (tmp_path / 'identify.py').write_text(text, encoding='utf-8')
    assert len({*commands_of(tmp_path)}) == 1
