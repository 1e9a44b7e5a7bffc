"""Damaged bags of every kind: the commands end with a result or a sentence.

`BARC_SIM_SOAK=1 pytest tests/bags/test_fuzz.py` damages 10,000 bags; without it, 200, of which 150
are slow.
"""

from __future__ import annotations

import contextlib
import os
import random
from typing import TYPE_CHECKING

import pytest
from made_bags import GRAPH, fill, parameters
from matplotlib.figure import Figure

from barc_sim.bags import reader as bag
from barc_sim.bags.recovery import recover
from barc_sim.bags.writer import BagWriter
from barc_sim.commands.regrade import in_words
from barc_sim.errors import UserError
from barc_sim.figures import run_figures as plots
from barc_sim.figures import side_view
from barc_sim.lab.regrade.judging import judge
from barc_sim.lab.report.facts import read
from barc_sim.lab.report.page import page
from barc_sim.simulation.closed_loop import closed_loop

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path


BAGS = 10_000 if 'BARC_SIM_SOAK' in os.environ else 200
#: Bags of one test, so that several processes share the work.
AT_ONCE = 50
PARTS = [pytest.param(k, marks=[pytest.mark.slow] * (k > 0)) for k in range(BAGS // AT_ONCE)]


@pytest.fixture(scope='module')
def originals(tmp_path_factory: pytest.TempPathFactory) -> list[bytes]:
    """Return the file of a short run, finished and killed."""
    directory = tmp_path_factory.mktemp('fuzz') / 'run'
    directory.mkdir()
    log = closed_loop(distance=2.0)
    metadata = {
        'command': 'acc',
        'kp': '30.0',
        'road': 'lab',
        'graph': GRAPH,
        'parameters': parameters(),
    }
    source = {'student/bike_model.py': b'def bikeFE():\n    pass\n'}
    writer = BagWriter(directory, metadata=metadata)
    writer.attach(source)
    fill(writer, log)
    killed = writer.file.read_bytes()
    writer.close()
    return [writer.file.read_bytes(), killed]


def mutate(content: bytes, chance: random.Random) -> bytes:
    """Return it with a few bytes changed, cut or inserted."""
    changed = bytearray(content)
    for _ in range(chance.randint(1, 8)):
        at = chance.randrange(len(changed) + 1)
        length = min(int(chance.expovariate(0.05)) + 1, 2000)
        match chance.choice(('change', 'cut', 'insert', 'end')):
            case 'change':
                changed[at : at + length] = chance.randbytes(len(changed[at : at + length]))
            case 'cut':
                del changed[at : at + length]
            case 'insert':
                changed[at:at] = chance.randbytes(length)
            case _:
                if chance.random() < 0.1:  # else most bags would be short
                    del changed[at:]
    return bytes(changed)


def plot(path: Path) -> None:
    plots.speed_figure(bag.read(path), title='', settings=str(bag.info(path)), figure=Figure())


def replay(path: Path) -> None:
    side_view.SideView(bag.read(path), Figure(figsize=side_view.SIZE), title='').update(0.1)


def report(path: Path) -> None:
    page(read(path))


def regrade(path: Path) -> None:
    in_words(judge(path))


@pytest.mark.timeout(AT_ONCE * 10)
@pytest.mark.parametrize('part', PARTS)
def test_damage_ends_in_no_traceback_and_no_hang(
    originals: list[bytes], tmp_path: Path, part: int
) -> None:
    chance = random.Random(part)  # noqa: S311 (no secret)
    draw: tuple[Callable[[Path], object], ...] = (plot, replay) * 3 + (report, regrade)
    for number in range(AT_ONCE):
        file = tmp_path / f'run_{number}.mcap'
        file.write_bytes(mutate(chance.choice(originals), chance))
        for command in (draw[number % len(draw)], recover):
            with contextlib.suppress(UserError):
                command(file)
        # Read what recover has made or left.
        with contextlib.suppress(UserError):
            bag.read(file)
        for path in tmp_path.iterdir():
            path.unlink()
