"""A recording of 20 MB/s and 5,000 messages/s, split by time, killed with -9 ten times at random.

`barc record` records what another process publishes, and is started again after each kill. Every
file of the bag but the last one must be whole, with the messages that its summary counts, and the
last one must be readable up to its last chunk.
"""

from __future__ import annotations

import json
import random
import subprocess
import sys
import tempfile
import time
from collections import defaultdict
from contextlib import contextmanager
from pathlib import Path
from shutil import rmtree
from typing import TYPE_CHECKING, NamedTuple

from _figures import Figure, spread
from _numbered import HEAD
from mcap.exceptions import McapError
from mcap.reader import SeekingReader
from rosbags.rosbag2 import Reader, ReaderError

from barc_sim.bags.contents import Contents
from barc_sim.cli.parser import number, whole
from barc_sim.errors import UserError

if TYPE_CHECKING:
    import argparse
    from collections.abc import Iterator

SHORT = '20 s in all, split by 0.5 s; any loss before a kill will do'
_TASK = {'topics': 5, 'rate': 5000, 'size': 4000}
_KILLS = 10
#: [s] of messages before a kill that a bag may lack.
_MAX_LOSS = 0.5
#: [ns] from the first message on: DDS sends messages of before the subscription, with gaps.
_SETTLING_TIME = 500_000_000
_STARTED = 1 << 20  #: [B] in a bag whose recorder has discovered the topics
_TIMEOUT = 60.0  #: [s]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    parser.add_argument(
        '--seconds', type=whole(1), default=7200, help='of all recordings together (7200)'
    )
    parser.add_argument(
        '--max-bag-duration', type=number(0.1, 1e6), default=60.0, help='of a file [s] (60)'
    )
    parser.add_argument('--folder', help='where to record at 20 MB/s; each bag is removed')


def soak(options: argparse.Namespace) -> list[Figure]:
    """Return the figures."""
    seconds = 20.0 if options.short else options.seconds
    duration = 0.5 if options.short else options.max_bag_duration
    chance = random.Random(4)  # noqa: S311 (no secret)

    bags = []
    with tempfile.TemporaryDirectory(dir=options.folder) as name, _publisher():
        for kill in range(1, _KILLS + 1):
            path = Path(name, str(kill))
            killed = _record(path, seconds / _KILLS * chance.uniform(0.5, 1.5), duration)
            bag = _look_at(path, killed)
            print(f'{kill}: {bag}', file=sys.stderr)
            bags.append(bag)
            rmtree(path)
    return _figures(bags, is_long=not options.short)


class _KilledBag(NamedTuple):
    """What is left of a recording whose recorder was killed."""

    seconds: float  #: from the first message to the last one
    messages: int
    closed: int  #: number of files but the last one
    broken: int  #: how many of them are not whole
    missing: int  #: number of messages missing between others, once subscriptions have settled
    loss: float  #: [s] from the last message to the kill


def _figures(bags: list[_KilledBag], *, is_long: bool) -> list[Figure]:
    seconds = sum(bag.seconds for bag in bags)
    messages = sum(bag.messages for bag in bags)
    losses = [bag.loss for bag in bags]
    # A machine that tests share is late for reasons of its own.
    min_rate = 0.95 * _TASK['rate'] if is_long else 1.0
    max_missing = 0 if is_long else messages
    max_loss = _MAX_LOSS if is_long else _TIMEOUT
    return [
        Figure('kills', len(bags), minimum=_KILLS),
        Figure('recorded, s', seconds),
        Figure('messages written', messages),
        Figure('messages written, 1/s', messages / seconds, minimum=min_rate),
        Figure('closed files', sum(bag.closed for bag in bags), minimum=_KILLS),
        Figure('closed files that are not whole', sum(bag.broken for bag in bags), maximum=0),
        Figure('missing between others', sum(bag.missing for bag in bags), maximum=max_missing),
        *spread('missing before a kill, s', losses, max_loss),
    ]


@contextmanager
def _publisher() -> Iterator[None]:
    """Publish in a process of its own."""
    program = str(Path(__file__).with_name('_numbered.py'))
    with subprocess.Popen([sys.executable, program, json.dumps(_TASK)]) as process:  # noqa: S603 (our own)
        try:
            yield
        finally:
            process.terminate()


def _record(bag: Path, seconds: float, max_bag_duration: float) -> int:
    """Record for some time, kill the recorder, and return when [ns]."""
    command = [
        *(sys.executable, '-m', 'barc_sim', 'record', '-o', str(bag)),
        *('--max-bag-duration', str(max_bag_duration), '--topics', 'numbered'),
    ]
    with subprocess.Popen(command, stdin=subprocess.DEVNULL) as recorder:  # noqa: S603 (our own)
        try:
            _wait_for_messages(bag)
            time.sleep(seconds)
        finally:
            killed = time.time_ns()
            recorder.kill()
    return killed


def _wait_for_messages(bag: Path) -> None:
    end = time.monotonic() + _TIMEOUT
    while sum(file.stat().st_size for file in bag.glob('*.mcap')) < _STARTED:
        if time.monotonic() > end:
            raise RuntimeError(f'nothing is recorded in {bag} after {_TIMEOUT:g} s')
        time.sleep(0.05)


def _look_at(path: Path, killed: int) -> _KilledBag:
    """Read a bag whose recorder was killed at a time [ns]."""
    contents = Contents(path)
    first: dict[str, int] = {}  # number of a topic's first message
    last: dict[str, int] = {}
    counts: defaultdict[str, int] = defaultdict(int)
    counted_from = None
    for message in contents.messages():
        counted_from = counted_from or message.received + _SETTLING_TIME
        if message.received < counted_from:
            continue
        name = message.topic.name
        *_, last[name] = HEAD.unpack_from(message.data)
        first.setdefault(name, last[name])
        counts[name] += 1

    closed = [file.path for file in contents.files][:-1]
    start = contents.span.start or 0
    return _KilledBag(
        seconds=contents.span.duration / 1e9,
        messages=contents.span.count,
        closed=len(closed),
        broken=sum(not _is_whole(file) for file in closed),
        missing=sum(last[name] - first[name] + 1 - counts[name] for name in counts),
        loss=(killed - start - contents.span.duration) / 1e9,
    )


def _is_whole(file: Path) -> bool:
    """Return whether a file has all that its summary describes."""
    try:
        with file.open('rb') as stream:
            summary = SeekingReader(stream, validate_crcs=True).get_summary()
        contents = Contents(file)
        contents.read_all()
        with Reader(file) as reader:
            count = reader.message_count
    except (McapError, ReaderError, UserError) as error:
        print(f'{file}: {error}', file=sys.stderr)
        return False

    counted = summary.statistics.message_count if summary and summary.statistics else 0
    return not contents.damages and contents.span.count == counted == count > 0
