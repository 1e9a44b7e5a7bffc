"""A slice of `jitter`: its task is JSON on the command line, so is what it finds."""

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
from rclpy.executors import MultiThreadedExecutor, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.task import Future
from std_msgs.msg import Header

from barc_sim.nodes.recorder import BagRecorder
from barc_sim.ros.executor import QuickExecutor

if TYPE_CHECKING:
    from collections.abc import Callable

_PERIOD = 0.02  # s
_WARM_UP = 1.0  # s
_LATE = 1.0  # ms


class Ticker(Node):
    """Publishes on many topics at 50 Hz, and calls `note` each time."""

    def __init__(self, note: Callable[[], None]) -> None:
        super().__init__('ticker')
        self._note = note
        self._outlets = [self.create_publisher(Header, f'topic_{i}', 10) for i in range(7)]
        self.create_timer(_PERIOD, self._tick)

    def _tick(self) -> None:
        self._note()
        for outlet in self._outlets:
            outlet.publish(Header())


class Blocker(Node):
    """Blocks its thread for 100 ms in every 200 ms: it sleeps, or it computes."""

    def __init__(self, blocks: str) -> None:
        super().__init__('blocker')
        self.create_timer(0.2, _BLOCKS[blocks])


def _compute() -> None:
    end = time.perf_counter() + 0.1
    while time.perf_counter() < end:
        pass


_BLOCKS = {'sleeps': lambda: time.sleep(0.1), 'computes': _compute}


class Clock:
    """Notes the time, how long the kernel has kept this thread waiting, and the processor time."""

    def __init__(self) -> None:
        self.ticks: list[tuple[float, float, float, int]] = []
        self.counted = 0  #: by a busy thread
        self._thread = threading.local()  # another one may take over

    def __call__(self) -> None:
        """Note now, and the wait since this thread did so before."""
        now = time.perf_counter()
        thread = self._thread
        if not hasattr(thread, 'file'):
            thread.file = os.open('/proc/thread-self/schedstat', os.O_RDONLY)
            thread.waited = 0.0
        waited = int(os.pread(thread.file, 100, 0).split()[1]) * 1e-9
        self.ticks.append((now, waited - thread.waited, time.process_time(), self.counted))
        thread.waited = waited

    def count(self) -> None:
        """Count for ever, as a busy thread does."""
        while True:
            self.counted += 1


def main(task: dict[str, Any]) -> dict[str, Any]:
    """Tick; return their number, the core used [%], and the lateness and wait of late ones [ms]."""
    clock = Clock()
    name, beside = task['subject'].split()
    if beside == 'counts':
        threading.Thread(target=clock.count, daemon=True).start()
    if name == 'loop':
        if beside in _BLOCKS:
            threading.Thread(target=_block, args=(_BLOCKS[beside],), daemon=True).start()
        _loop(clock, _WARM_UP + task['seconds'])
    else:
        _spin(clock, name, beside, _WARM_UP + task['seconds'])
    ticks = clock.ticks[int(_WARM_UP / _PERIOD) :]
    gaps = [
        ((now - before - _PERIOD) * 1e3, waited * 1e3)
        for (before, *_), (now, waited, *_) in pairwise(ticks)
    ]
    began, _, before, first = ticks[0]
    ended, _, after, last = ticks[-1]
    return {
        'ticks': len(gaps),
        'core': (after - before) / (ended - began) * 100.0,
        'p99, ms': quantiles((abs(gap) for gap, _ in gaps), n=100)[98],
        'less waiting': quantiles((gap - waited for gap, waited in gaps), n=100)[98],
        'late': [gap for gap in gaps if gap[0] > _LATE],
        'counted': (last - first) / (ended - began),
    }


def _block(block: Callable[[], None]) -> None:
    """Block for 100 ms in every 200 ms for ever, as the node does."""
    while True:
        block()
        time.sleep(0.1)


def _loop(clock: Clock, seconds: float) -> None:
    due = time.perf_counter()
    end = due + seconds
    while due < end:
        due += _PERIOD
        time.sleep(max(0.0, due - time.perf_counter()))
        clock()


def _spin(clock: Clock, name: str, blocks: str, seconds: float) -> None:
    rclpy.init(args=[], domain_id=os.getpid() % 100 + 1)
    with tempfile.TemporaryDirectory() as folder:
        nodes: list[Any] = [Ticker(clock), BagRecorder(Path(folder))]
        if blocks in _BLOCKS:
            nodes.append(Blocker(blocks))
        executor = {
            'single': SingleThreadedExecutor,
            'multi': lambda: MultiThreadedExecutor(num_threads=2),
            'ours': lambda: QuickExecutor(num_threads=2),
        }[name]()
        for node in nodes:
            executor.add_node(node)
        executor.spin_until_future_complete(Future(), seconds)
        executor.shutdown()
        for node in nodes:
            node.destroy_node()
        rclpy.shutdown()


if __name__ == '__main__':
    print(json.dumps(main(json.loads(sys.argv[1]))))
