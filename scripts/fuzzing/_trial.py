"""Tries damaged files in processes that are ended where they hang or take too much memory."""

from __future__ import annotations

import gc
import logging
import multiprocessing
import resource
import shutil
import sys
import tempfile
import time
import traceback
from pathlib import Path
from random import Random
from typing import TYPE_CHECKING, Any, NamedTuple

from barc_sim.errors import UserError

if TYPE_CHECKING:
    from collections.abc import Iterator
    from multiprocessing.connection import Connection

SECONDS = 10.0  #: for each use of a file
MEBIBYTES = 300.0  #: of memory that a use takes
_PATIENCE = 12 * SECONDS  # on a busy machine; also a use that ends is to be measured
_ADDRESSES = 4 << 30  # bytes; more is refused to a process
_AT_ONCE = 250  # files of one process

#: What can become of a file, or of a command.
RESULT = 'result'
SENTENCE = 'sentence'
TRACEBACK = 'traceback'
HANG = 'hang'
MEMORY = 'memory'
ESCAPE = 'escape'


class Trial(NamedTuple):
    """What became of a file."""

    number: int
    damaged: str = ''  #: what was damaged in it
    outcome: str = HANG
    seconds: float = 0.0  #: of the longest use
    mebibytes: float = 0.0  #: the most
    why: str = ''


def trials(kind: Any, seed: int, numbers: range) -> Iterator[Trial]:  # noqa: ANN401 (a module)
    """Yield what became of each file; `kind` is the module that makes and uses them."""
    todo = list(numbers)
    while todo:
        receiver, sender = multiprocessing.Pipe(duplex=False)
        process = multiprocessing.get_context('fork').Process(
            target=_try_all, args=(kind, seed, todo[:_AT_ONCE], sender)
        )
        gc.freeze()  # the new process must destroy nothing of this one, such as handles of ROS
        process.start()
        gc.unfreeze()
        sender.close()
        yield from _received(receiver, todo, min(_AT_ONCE, len(todo)))
        process.kill()
        process.join()


def _received(receiver: Connection, todo: list[int], count: int) -> Iterator[Trial]:
    """Yield what a process reports, and a hang where it does not; take it from `todo`."""
    for _ in range(count):
        trial = Trial(todo.pop(0))
        try:
            if receiver.poll(_PATIENCE):
                trial = receiver.recv()
            else:
                trial = trial._replace(why=f'no end within {_PATIENCE:g} s')
        except EOFError:
            trial = trial._replace(outcome=MEMORY, why='the process was killed')
        yield trial
        if trial.outcome in (HANG, MEMORY):
            return


def content(kind: Any, seed: int, number: int) -> tuple[str, str, bytes, Random]:  # noqa: ANN401
    """Return suffix, damage and content of a file, and the chances of its uses."""
    chance = Random(f'{seed} {number}')  # noqa: S311 (no secret)
    return *kind.damaged(chance), chance


def _try_all(kind: Any, seed: int, numbers: list[int], sender: Connection) -> None:  # noqa: ANN401
    resource.setrlimit(resource.RLIMIT_AS, (_ADDRESSES, _ADDRESSES))
    logging.disable()
    with tempfile.TemporaryDirectory() as folder:
        for number in numbers:
            place = Path(folder, str(number))
            place.mkdir()
            sender.send(_try(kind, seed, number, place))
            shutil.rmtree(place)


def _try(kind: Any, seed: int, number: int, place: Path) -> Trial:  # noqa: ANN401
    suffix, damaged, data, chance = content(kind, seed, number)
    path = place / f'run_0{suffix}'
    path.write_bytes(data)
    del data  # which would count
    Path('/proc/self/clear_refs').write_text('5', encoding='ascii')  # the peak begins anew
    held = _peak()  # of the process before it was forked, too
    trial = Trial(number, damaged, RESULT)
    for use in kind.uses(chance):
        clock = getattr(kind, 'clock', time.monotonic)
        began = clock()
        try:
            use(path)
        except UserError:
            trial = trial._replace(outcome=SENTENCE)
        except Exception:  # noqa: BLE001 (what is looked for)
            trial = trial._replace(outcome=TRACEBACK, why=traceback.format_exc())
            break
        finally:
            seconds = max(clock() - began, trial.seconds)
            trial = trial._replace(seconds=seconds, mebibytes=_peak() - held)
        if seconds > SECONDS or trial.mebibytes > MEBIBYTES:
            outcome = HANG if seconds > SECONDS else MEMORY
            return trial._replace(outcome=outcome, why=str(use))
    return trial


def _peak() -> float:
    """Return the most memory that this process held [MiB]."""
    for line in Path('/proc/self/status').read_text(encoding='ascii').splitlines():
        if line.startswith('VmHWM:'):
            return int(line.split()[1]) / 1024
    sys.exit('Linux gives no figure for the memory of a process')
