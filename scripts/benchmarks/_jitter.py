"""A slice of `jitter`: its task is JSON on the command line, and so are its figures."""

from __future__ import annotations

import json
import os
import sys
import tempfile
import threading
import time
from itertools import pairwise
from pathlib import Path
from statistics import quantiles
from typing import TYPE_CHECKING, Any

import rclpy
from _ticks import TickLog
from rclpy.executors import MultiThreadedExecutor, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.task import Future
from std_msgs.msg import Header

from barc_sim.nodes.recorder import BagRecorder
from barc_sim.ros.executor import QuickExecutor

if TYPE_CHECKING:
    from collections.abc import Callable

    from _ticks import Tick

_PERIOD = 0.02  # s
_WARM_UP = 1.0  # s
_LATE = 1.0  # ms
_TOPICS = 7


class Ticker(Node):
    """Publishes on many topics at 50 Hz, and calls `note` each time."""

    def __init__(self, note: Callable[[], None]) -> None:
        super().__init__('ticker')
        self._note = note
        self._header_pubs = [
            self.create_publisher(Header, f'topic_{number}', 10) for number in range(_TOPICS)
        ]
        self.create_timer(_PERIOD, self._tick)

    def _tick(self) -> None:
        self._note()
        for publisher in self._header_pubs:
            publisher.publish(Header())


class Blocker(Node):
    """Blocks its thread for 100 ms in every 200 ms: it sleeps, or it computes."""

    def __init__(self, block: Callable[[], None]) -> None:
        super().__init__('blocker')
        self.create_timer(0.2, block)


def _sleep() -> None:
    time.sleep(0.1)


def _compute() -> None:
    end = time.perf_counter() + 0.1
    while time.perf_counter() < end:
        pass


_BLOCKS = {'sleeps': _sleep, 'computes': _compute}


def main(task: dict[str, Any]) -> dict[str, Any]:
    """Tick; return the number of ticks, the core used [%], and how late ticks were [ms].

    A late tick has two numbers: by how much it is late, and how long the thread waited for a core.
    """
    log = TickLog()
    name, neighbour = task['subject'].split()
    seconds = _WARM_UP + task['seconds']
    if neighbour == 'counts':
        threading.Thread(target=log.count, daemon=True).start()

    block = _BLOCKS.get(neighbour)
    if name == 'loop':
        if block:
            threading.Thread(target=_block_for_ever, args=(block,), daemon=True).start()
        _loop(log, seconds)
    else:
        _spin(log, name, block, seconds)
    return _figures(log.ticks[int(_WARM_UP / _PERIOD) :])


def _block_for_ever(block: Callable[[], None]) -> None:
    """Block for 100 ms in every 200 ms, as the node does."""
    while True:
        block()
        time.sleep(0.1)


def _loop(log: TickLog, seconds: float) -> None:
    due = time.perf_counter()
    end = due + seconds
    while due < end:
        due += _PERIOD
        time.sleep(max(0.0, due - time.perf_counter()))
        log.note()


def _spin(log: TickLog, name: str, block: Callable[[], None] | None, seconds: float) -> None:
    rclpy.init(args=[], domain_id=os.getpid() % 100 + 1)
    with tempfile.TemporaryDirectory() as folder:
        nodes: list[Any] = [Ticker(log.note), BagRecorder(Path(folder))]
        if block:
            nodes.append(Blocker(block))

        executor = _executor(name)
        for node in nodes:
            executor.add_node(node)
        executor.spin_until_future_complete(Future(), seconds)

        executor.shutdown()
        for node in nodes:
            node.destroy_node()
        rclpy.shutdown()


def _executor(name: str) -> Any:  # noqa: ANN401 (any executor)
    if name == 'single':
        return SingleThreadedExecutor()
    if name == 'multi':
        return MultiThreadedExecutor(num_threads=2)
    return QuickExecutor(num_threads=2)


def _figures(ticks: list[Tick]) -> dict[str, Any]:
    lateness = [(tick.time - before.time - _PERIOD) * 1e3 for before, tick in pairwise(ticks)]
    waits = [tick.wait * 1e3 for tick in ticks[1:]]
    pairs = list(zip(lateness, waits, strict=True))

    first = ticks[0]
    last = ticks[-1]
    seconds = last.time - first.time
    return {
        'ticks': len(lateness),
        'core': (last.processor - first.processor) / seconds * 100.0,
        'p99, ms': _percentile_99([abs(late) for late in lateness]),
        'less waiting': _percentile_99([late - wait for late, wait in pairs]),
        'late': [(late, wait) for late, wait in pairs if late > _LATE],
        'counted': (last.counter - first.counter) / seconds,
    }


def _percentile_99(values: list[float]) -> float:
    return quantiles(values, n=100)[98]


if __name__ == '__main__':
    print(json.dumps(main(json.loads(sys.argv[1]))))
