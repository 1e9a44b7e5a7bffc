"""Two nodes that answer one another, in default groups; task and figures are JSON.

It runs in other environments, too, and imports barc_sim only for its executor.
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

    def __init__(
        self,
        subscribed: str,
        published: str,
        note: Callable[[], None],
    ) -> None:
        super().__init__(published)
        self._note = note
        self._publisher = self.create_publisher(Header, published, 10)
        self._subscription = self.create_subscription(Header, subscribed, self.answer, 10)

    def is_connected(self) -> bool:
        """Return whether there is another player."""
        subscribed = self._publisher.get_subscription_count()
        return bool(subscribed and self._subscription.get_publisher_count())

    def answer(self, message: Header) -> None:
        """Answer the message."""
        self._note()
        self._publisher.publish(Header(stamp=message.stamp))


class Rounds:
    """Notes the time of each round, and ends the process with the figures when it is over."""

    def __init__(self, seconds: float) -> None:
        self._times: list[float] = []
        self._seconds = seconds
        self.at_end: Callable[[], object] = list
        self._begun = self._processor = 0.0
        self._counted = 0
        self._counting = 0

    def count(self) -> None:
        """Count for ever, as a busy thread does."""
        while True:
            self._counting += 1

    def note(self) -> None:
        """Note now."""
        now = time.perf_counter()
        self._times.append(now)
        if not self._begun:
            self._begun = now + _WARM_UP
        elif not self._processor and now > self._begun:
            self._times.clear()
            self._begun = now
            self._processor = time.process_time()
            self._counted = self._counting
        elif self._processor and now > self._begun + self._seconds:
            print(json.dumps(self._figures(now - self._begun)), flush=True)
            self.at_end()
            os._exit(0)  # no executor's end is measured

    def _figures(self, took: float) -> dict[str, float]:
        times = self._times
        rounds = [(b - a) * 1e6 for a, b in zip(times, times[1:])]  # noqa: B905, RUF007
        while len(rounds) < 2:  # noqa: PLR2004 (of so few, one took all the time)
            rounds.append(took * 1e6)
        shares = quantiles(rounds, n=100)
        return {
            'round trips/s': len(times) / took,
            'p50, us': shares[49],
            'p99, us': shares[98],
            'core, %': (time.process_time() - self._processor) / took * 100.0,
            'other thread, 1/s': (self._counting - self._counted) / took,
        }


def _executor(name: str) -> Any:  # noqa: ANN401
    """Return an executor."""
    if name == 'ours':
        from barc_sim.ros.executor import QuickExecutor  # noqa: PLC0415

        return QuickExecutor(num_threads=2)
    if name in ('events', 'kilted'):
        from rclpy.experimental import EventsExecutor  # noqa: PLC0415

        return EventsExecutor()
    return SingleThreadedExecutor() if name == 'single' else MultiThreadedExecutor(num_threads=2)


def main(task: dict[str, Any]) -> None:
    """Play until the time is over, or as the `peer` for ever."""
    rounds = Rounds(task['seconds'])
    domain = task.setdefault('domain', os.getpid() % 100 + 1)
    rclpy.init(args=[], domain_id=domain)
    executor = _executor(task['executor'])
    peer = task.get('peer', False)
    apart = 'two processes' in task['case']
    players = []
    if not peer:
        players.append(Player('pong', 'ping', rounds.note))
    if peer or not apart:
        players.append(Player('ping', 'pong', lambda: None))
    for player in players:
        executor.add_node(player)
    if 'recorded' in task['case']:
        rounds.at_end = _record(executor)
    if apart and not peer:
        arguments = json.dumps({**task, 'peer': True})
        with subprocess.Popen([sys.executable, __file__, arguments]) as other:  # noqa: S603
            while not players[0].is_connected():
                time.sleep(0.1)
            time.sleep(1.0)  # the peer may find this process later than it is found
            rounds.at_end = other.kill
            _play(executor, players, rounds, task)
    else:
        _play(executor, [] if peer else players, rounds, task)


def _record(executor: Any) -> Callable[[], object]:  # noqa: ANN401
    """Add a recorder; return what ends it and removes its bag."""
    from barc_sim.nodes.recorder import BagRecorder  # noqa: PLC0415 (in ours alone)

    folder = tempfile.TemporaryDirectory()
    recorder = BagRecorder(Path(folder.name))
    executor.add_node(recorder)

    def end() -> None:
        recorder.close()  # it makes a bag that is removed anew
        folder.cleanup()

    return end


def _play(executor: Any, players: list[Player], rounds: Rounds, task: dict[str, Any]) -> None:  # noqa: ANN401
    if 'busy' in task['case']:
        threading.Thread(target=rounds.count, daemon=True).start()
    if players:
        players[0].answer(Header())
    executor.spin()


if __name__ == '__main__':
    main(json.loads(sys.argv[1]))
