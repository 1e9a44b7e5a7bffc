"""Records numbered messages into a split bag as fast as it can, until it is killed.

Arguments: the bag's directory, and the maximum size of a file [B]. The file `flushed` beside the
bag has the number of messages that were handed to the operating system.
"""

from __future__ import annotations

import itertools
import mmap
import os
import sys
import time
from pathlib import Path
from struct import Struct

from barc_sim.bags.messages import BagMessage, Topic
from barc_sim.bags.writer import BagWriter
from barc_sim.bags.writer_thread import WriterThread

_NUMBER = Struct('<Q')
_BURST = 200  #: messages of a poll
_SIZE = 500  #: [B] of a message
_NOISE = os.urandom(2**20)
_TOPIC = Topic(name='/value', type='a/msg/B', definition='', type_hash='', offered_qos=[])


class _CountingWriter(BagWriter):
    """Stores how many messages are on the disk."""

    flushed: mmap.mmap
    written = 0

    def flush(self) -> None:
        super().flush()
        self.flushed[:] = _NUMBER.pack(sum(self.on_disk.values()))


def _noise(number: int) -> bytes:
    """Return what zstd cannot compress."""
    start = number * _SIZE % (len(_NOISE) - _SIZE)
    return _NOISE[start : start + _SIZE]


def main() -> None:
    """Record until this process is killed."""
    directory = Path(sys.argv[1])
    directory.mkdir()
    counter = directory.with_name('flushed')
    counter.write_bytes(_NUMBER.pack(0))
    numbers = itertools.count()

    def burst() -> list[BagMessage]:
        now = time.time_ns()
        return [
            BagMessage(_TOPIC, _noise(number), now, now, number)
            for number in itertools.islice(numbers, _BURST)
        ]

    with counter.open('r+b') as stream:
        writer = _CountingWriter(directory, metadata={'a': 'b'}, max_size=int(sys.argv[2]))
        writer.flushed = mmap.mmap(stream.fileno(), _NUMBER.size)
        thread = WriterThread(writer, burst, 0, sys.exit, cache_size=100 * 2**20)
        thread.start()
        time.sleep(600.0)


if __name__ == '__main__':
    main()
