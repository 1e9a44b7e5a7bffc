"""Two nodes that answer one another, in default groups; task and figures are JSON.

This program runs in other environments, too, and imports barc_sim only for its executor.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path
from statistics import quantiles
from typing import TYPE_CHECKING, Any

import rclpy
from rclpy.executors import MultiThreadedExecutor, SingleThreadedExecutor
from rclpy.node import Node
from std_msgs.msg import Header

if TYPE_CHECKING:
    from collections.abc import Callable

_WARM_UP = 1.0  # s


class Player(Node):
    """Answers each message on one topic with one on another, and calls `note` each time."""

    def __init__(self, question: str, answer: str, note: Callable[[], None]) -> None:
        super().__init__(answer)
        self._note = note
        self._publisher = self.create_publisher(Header, answer, 10)
        self._subscription = self.create_subscription(Header, question, self.answer, 10)

    def is_connected(self) -> bool:
        """Return whether there is another player."""
        has_subscriber = self._publisher.get_subscription_count() > 0
        has_publisher = self._subscription.get_publisher_count() > 0
        return bool(has_subscriber and has_publisher)

    def answer(self, message: Header) -> None:
        """Answer the message."""
        self._note()
        self._publisher.publish(Header(stamp=message.stamp))


class Rounds:
    """Notes the time of each round, and ends the process with the figures when it is over."""

    def __init__(self, seconds: float) -> None:
        self.at_end: Callable[[], object] = list
        self._seconds = seconds
        self._times: list[float] = []
        self._start = 0.0  #: [s] of the measurement, which follows a warm-up
        self._processor_at_start = 0.0
        self._counter = 0
        self._counter_at_start = 0

    def count(self) -> None:
        """Count for ever, as a busy thread does."""
        while True:
            self._counter += 1

    def note(self) -> None:
        """Add a round that ends now."""
        now = time.perf_counter()
        self._times.append(now)
        is_measuring = self._processor_at_start > 0.0
        if not self._start:
            self._start = now + _WARM_UP
        elif not is_measuring and now > self._start:
            self._begin(now)
        elif is_measuring and now > self._start + self._seconds:
            self._end(now)

    def _begin(self, now: float) -> None:
        self._times.clear()
        self._start = now
        self._processor_at_start = time.process_time()
        self._counter_at_start = self._counter

    def _end(self, now: float) -> None:
        print(json.dumps(self._figures(now - self._start)), flush=True)
        self.at_end()
        os._exit(0)  # no executor's end is measured

    def _figures(self, seconds: float) -> dict[str, float]:
        times = self._times
        rounds = [(b - a) * 1e6 for a, b in zip(times, times[1:])]  # noqa: B905, RUF007
        while len(rounds) < 2:  # noqa: PLR2004 (of so few, one took all the time)
            rounds.append(seconds * 1e6)

        percentiles = quantiles(rounds, n=100)
        processor = time.process_time() - self._processor_at_start
        return {
            'round trips/s': len(times) / seconds,
            'p50, us': percentiles[49],
            'p99, us': percentiles[98],
            'core, %': processor / seconds * 100.0,
            'other thread, 1/s': (self._counter - self._counter_at_start) / seconds,
        }


def main(task: dict[str, Any]) -> None:
    """Play until the time is over, or as the `peer` for ever."""
    domain = task.setdefault('domain', os.getpid() % 100 + 1)
    rclpy.init(args=[], domain_id=domain)
    rounds = Rounds(task['seconds'])
    is_peer = task.get('peer', False)
    has_peer = 'two processes' in task['case']

    players = []
    if not is_peer:
        players.append(Player('pong', 'ping', rounds.note))
    if is_peer or not has_peer:
        players.append(Player('ping', 'pong', _note_nothing))
    executor = _executor(task['executor'])
    for player in players:
        executor.add_node(player)

    if 'recorded' in task['case']:
        rounds.at_end = _record(executor)
    if 'busy' in task['case']:
        threading.Thread(target=rounds.count, daemon=True).start()
    if is_peer:
        executor.spin()
    elif has_peer:
        _play_with_peer(executor, players[0], rounds, task)
    else:
        _play(executor, players[0])


def _note_nothing() -> None:
    pass


def _executor(name: str) -> Any:  # noqa: ANN401 (any executor)
    if name == 'ours':
        from barc_sim.ros.executor import QuickExecutor  # noqa: PLC0415

        return QuickExecutor(num_threads=2)
    if name in ('events', 'kilted'):
        from rclpy.experimental import EventsExecutor  # noqa: PLC0415

        return EventsExecutor()
    if name == 'single':
        return SingleThreadedExecutor()
    return MultiThreadedExecutor(num_threads=2)


def _record(executor: Any) -> Callable[[], object]:  # noqa: ANN401
    """Add a recorder; return what ends it and removes its bag."""
    from barc_sim.nodes.recorder import BagRecorder  # noqa: PLC0415 (in barc_sim alone)

    folder = tempfile.TemporaryDirectory()
    recorder = BagRecorder(Path(folder.name))
    executor.add_node(recorder)

    def end() -> None:
        recorder.close()  # it makes a bag that is removed anew
        folder.cleanup()

    return end


def _play_with_peer(executor: Any, player: Player, rounds: Rounds, task: dict[str, Any]) -> None:  # noqa: ANN401
    """Play with a player in another process, which ends with the rounds."""
    words = json.dumps({**task, 'peer': True})
    with subprocess.Popen([sys.executable, __file__, words]) as peer:  # noqa: S603
        rounds.at_end = peer.kill
        while not player.is_connected():
            time.sleep(0.1)
        time.sleep(1.0)  # the peer may find this process later than it is found
        _play(executor, player)


def _play(executor: Any, player: Player) -> None:  # noqa: ANN401
    player.answer(Header())
    executor.spin()


if __name__ == '__main__':
    main(json.loads(sys.argv[1]))
