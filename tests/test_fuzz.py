"""Damaged bags of every kind: the commands end with a result or a sentence.

`BARC_SIM_SOAK=1 pytest tests/test_fuzz.py` changes 10,000 bags; without it, 200.
"""

from __future__ import annotations

import contextlib
import os
import random
from typing import TYPE_CHECKING

import pytest
from matplotlib.figure import Figure
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from barc_sim import bag, plots
from barc_sim.bags.metadata import Topic
from barc_sim.bags.recovery import recover
from barc_sim.bags.samples import TOPICS
from barc_sim.bags.schemas import definition
from barc_sim.bags.writer import BagWriter
from barc_sim.drawing import side_view
from barc_sim.errors import UserError
from barc_sim.rollout import rollout

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from barc_sim.log import Log

BAGS = 10_000 if 'BARC_SIM_SOAK' in os.environ else 200
#: Bags of one test, so that several processes share the work.
AT_ONCE = 50
PERIOD = 20_000_000
TYPES = get_typestore(Stores.EMPTY)
for _name in [topic.type for topic in TOPICS.values()]:
    TYPES.register(get_types_from_msg(definition(_name), _name))


def encoded(log: Log, k: int, topic: str) -> bytes:
    """Return the message of a topic that belongs to state `k`, in CDR."""
    name, types = TOPICS[topic].type, TYPES
    sec, nanosec = divmod(10**18 + k * PERIOD, 10**9)
    stamp = types.types['builtin_interfaces/msg/Time'](sec=sec, nanosec=nanosec)
    values = {
        field: getattr(log, column)[k].item() for field, column in TOPICS[topic].fields.items()
    }
    if topic == 'pid_state':
        values |= {'measurement': 0.0, 'error': 0.0, 'output': 0.0}
    header = types.types['std_msgs/msg/Header'](stamp=stamp, frame_id='')
    return bytes(types.serialize_cdr(types.types[name](header=header, **values), name))


@pytest.fixture(scope='module')
def originals(tmp_path_factory: pytest.TempPathFactory) -> list[bytes]:
    """Return the file of a short run, finished and killed."""
    directory = tmp_path_factory.mktemp('fuzz') / 'run'
    directory.mkdir()
    log = rollout(distance=2.0)
    writer = BagWriter(directory, metadata={'command': 'acc', 'kp': '30.0', 'road': 'lab'})
    for k in range(len(log)):
        for name in TOPICS:
            topic = Topic(
                name=f'/{name}',
                type=TOPICS[name].type,
                definition=definition(TOPICS[name].type),
                type_hash='',
                offered_qos=[],
            )
            now = 10**18 + k * PERIOD
            writer.write(topic, encoded(log, k, name), received=now, published=now, sequence=k)
        if k % 8 == 0:
            writer.flush()
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


@pytest.mark.timeout(AT_ONCE * 10)
@pytest.mark.parametrize('part', range(BAGS // AT_ONCE))
def test_damage_never_ends_in_a_traceback_nor_in_a_hang(
    originals: list[bytes], tmp_path: Path, part: int
) -> None:
    chance = random.Random(part)  # noqa: S311 (no secret)
    draw: tuple[Callable[[Path], object], ...] = (plot, replay)
    for number in range(AT_ONCE):
        file = tmp_path / f'run_{number}.mcap'
        file.write_bytes(mutate(chance.choice(originals), chance))
        for command in (draw[number % 2], recover):
            with contextlib.suppress(UserError):
                command(file)
        # What recover has made, or has left, is read again.
        with contextlib.suppress(UserError):
            bag.read(file)
        for path in tmp_path.iterdir():
            path.unlink()
