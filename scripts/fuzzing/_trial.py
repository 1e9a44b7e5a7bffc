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

MAX_SECONDS = 10.0  #: for each use of a file
MAX_MEBIBYTES = 300.0  #: of memory that a use takes
_TIMEOUT = 12 * MAX_SECONDS  # on a busy machine; also a use that ends must be measured
_ADDRESS_SPACE = 4 << 30  # bytes; more is refused to a process
_FILES_PER_PROCESS = 250

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
    damage: str = ''  #: what was damaged in it
    outcome: str = HANG
    seconds: float = 0.0  #: of the longest use
    mebibytes: float = 0.0  #: at most
    reason: str = ''  #: of a failure

    @property
    def is_failure(self) -> bool:
        """Whether it ended in neither a result nor a sentence."""
        return self.outcome not in (RESULT, SENTENCE)


class DamagedFile(NamedTuple):
    """A file that is to be read."""

    suffix: str
    damage: str  #: what is damaged in it
    content: bytes
    chance: Random  #: for its uses


def trials(kind: Any, seed: int, numbers: range) -> Iterator[Trial]:  # noqa: ANN401 (a module)
    """Yield what became of each file; `kind` is the module that makes and uses them."""
    todo = list(numbers)
    while todo:
        batch = todo[:_FILES_PER_PROCESS]
        receiver, sender = multiprocessing.Pipe(duplex=False)
        process = multiprocessing.get_context('fork').Process(
            target=_try_all, args=(kind, seed, batch, sender)
        )

        gc.freeze()  # the new process must destroy nothing of this one, such as handles of ROS
        process.start()
        gc.unfreeze()
        sender.close()

        yield from _reports(receiver, todo, len(batch))
        process.kill()
        process.join()


def _reports(receiver: Connection, todo: list[int], count: int) -> Iterator[Trial]:
    """Yield what a process reports, and a hang where it does not; take it from `todo`."""
    for _ in range(count):
        trial = Trial(todo.pop(0))
        try:
            if receiver.poll(_TIMEOUT):
                trial = receiver.recv()
            else:
                trial = trial._replace(reason=f'no end within {_TIMEOUT:g} s')
        except EOFError:
            trial = trial._replace(outcome=MEMORY, reason='the process was killed')
        yield trial
        if trial.outcome in (HANG, MEMORY):
            return


def make_file(kind: Any, seed: int, number: int) -> DamagedFile:  # noqa: ANN401 (a module)
    """Return the file with a number; the same seed makes the same file."""
    chance = Random(f'{seed} {number}')  # noqa: S311 (no secret)
    suffix, damage, content = kind.damaged_file(chance)
    return DamagedFile(suffix, damage, content, chance)


def _try_all(kind: Any, seed: int, numbers: list[int], sender: Connection) -> None:  # noqa: ANN401
    resource.setrlimit(resource.RLIMIT_AS, (_ADDRESS_SPACE, _ADDRESS_SPACE))
    logging.disable()
    with tempfile.TemporaryDirectory() as folder:
        for number in numbers:
            place = Path(folder, str(number))
            place.mkdir()
            sender.send(_try(kind, seed, number, place))
            shutil.rmtree(place)


def _try(kind: Any, seed: int, number: int, place: Path) -> Trial:  # noqa: ANN401
    file = make_file(kind, seed, number)
    path = place / f'run_0{file.suffix}'
    path.write_bytes(file.content)
    trial = Trial(number, file.damage, RESULT)
    uses = kind.uses(file.chance)
    del file  # its content would count

    Path('/proc/self/clear_refs').write_text('5', encoding='ascii')  # the peak begins anew
    memory_before = _peak()  # of the process before it was forked, too
    clock = getattr(kind, 'clock', time.monotonic)
    for use in uses:
        start = clock()
        try:
            use(path)
        except UserError:
            trial = trial._replace(outcome=SENTENCE)
        except Exception:  # noqa: BLE001 (what is looked for)
            trial = trial._replace(outcome=TRACEBACK, reason=traceback.format_exc())
            break
        finally:
            trial = trial._replace(
                seconds=max(clock() - start, trial.seconds),
                mebibytes=_peak() - memory_before,
            )

        if trial.seconds > MAX_SECONDS:
            return trial._replace(outcome=HANG, reason=str(use))
        if trial.mebibytes > MAX_MEBIBYTES:
            return trial._replace(outcome=MEMORY, reason=str(use))
    return trial


def _peak() -> float:
    """Return the largest memory of this process up to now [MiB]."""
    for line in Path('/proc/self/status').read_text(encoding='ascii').splitlines():
        if line.startswith('VmHWM:'):
            return int(line.split()[1]) / 1024
    sys.exit('Linux gives no figure for the memory of a process')
