"""One measurement of an executor: its task is JSON on the command line, so are its figures."""

from __future__ import annotations

import json
import os
import sys
import tempfile
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import rclpy
from rclpy.executors import MultiThreadedExecutor, SingleThreadedExecutor
from rclpy.node import Node
from std_msgs.msg import Header

from barc_sim.nodes.recorder.node import BagRecorder
from barc_sim.ros.executor import QuickCallbackGroup, QuickExecutor

if TYPE_CHECKING:
    from collections.abc import Callable

_TOPICS = 7
_PERIOD = 0.02  # s
_WARM_UP = 1.0  # s


class Player(Node):
    """Answers each message on one topic with one on another, and calls `note` each time."""

    def __init__(self, hears: str, says: str, note: Callable[[], None]) -> None:
        super().__init__(says)
        self._note = note
        self._publisher = self.create_publisher(Header, says, 10)
        group = QuickCallbackGroup()
        self.create_subscription(Header, hears, self.answer, 10, callback_group=group)

    def answer(self, message: Header) -> None:
        """Answer the message."""
        self._note()
        self._publisher.publish(Header(stamp=message.stamp))


class Ticker(Node):
    """Publishes on many topics at 50 Hz, and calls `note` each time."""

    def __init__(self, note: Callable[[], None]) -> None:
        super().__init__('ticker')
        self._note = note
        self._outlets = [self.create_publisher(Header, f'topic_{i}', 10) for i in range(_TOPICS)]
        self.create_timer(_PERIOD, self._tick, QuickCallbackGroup())

    def _tick(self) -> None:
        self._note()
        for outlet in self._outlets:
            outlet.publish(Header())


class Sleeper(Node):
    """Blocks its thread for 100 ms in every 200 ms."""

    def __init__(self) -> None:
        super().__init__('sleeper')
        self.create_timer(0.2, lambda: time.sleep(0.1))


def main(task: dict[str, Any]) -> dict[str, float]:
    """Measure; return the figures."""
    times: list[float] = []

    def note() -> None:
        times.append(time.perf_counter())

    rclpy.init(args=[], domain_id=os.getpid() % 100 + 1)
    with tempfile.TemporaryDirectory() as folder:
        nodes: list[Any] = (
            [Ticker(note), Sleeper()]
            if task['case'] == 'jitter'
            else [Player('pong', 'ping', note), Player('ping', 'pong', lambda: None)]
        )
        if task['case'] != 'ping-pong':
            nodes.append(BagRecorder(Path(folder)))
        executor: Any = {
            'ours': lambda: QuickExecutor(num_threads=2),
            'single': SingleThreadedExecutor,
            'multi': lambda: MultiThreadedExecutor(num_threads=2),
        }[task['executor']]()
        for node in nodes:
            executor.add_node(node)
        if isinstance(nodes[0], Player):
            nodes[0].answer(Header())

        _spin(executor, _WARM_UP)
        times.clear()
        began = time.perf_counter(), time.process_time()
        _spin(executor, task['seconds'])
        took, processor = time.perf_counter() - began[0], time.process_time() - began[1]

        executor.shutdown()
        for node in nodes:
            node.destroy_node()
        rclpy.shutdown()
    figures = _jitter(times) if task['case'] == 'jitter' else _rate(times, took)
    return {**figures, 'core, %': processor / took * 100.0}


def _spin(executor: Any, seconds: float) -> None:  # noqa: ANN401
    end = time.perf_counter() + seconds
    while time.perf_counter() < end:
        executor.spin_once(timeout_sec=0.1)


def _jitter(times: list[float]) -> dict[str, float]:
    off = np.abs(np.diff(times) - _PERIOD) * 1e3
    return {
        'p99, ms': float(np.percentile(off, 99)),
        'p50, ms': float(np.percentile(off, 50)),
        'max, ms': float(off.max()),
    }


def _rate(times: list[float], took: float) -> dict[str, float]:
    rounds = np.diff(times) * 1e6
    return {
        'rate, Hz': len(times) / took,
        'p50, us': float(np.percentile(rounds, 50)),
        'p99, us': float(np.percentile(rounds, 99)),
    }


if __name__ == '__main__':
    print(json.dumps(main(json.loads(sys.argv[1]))))
