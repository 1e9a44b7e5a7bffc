"""Each node killed with -9 and started again, 100 times at random: the run goes on.

The simulator, the controller, the relay, the recorder and the view run in processes of their own,
half of the time with the controller, and half with the relay in its place. Without
controller or relay the car brakes to a standstill, and it drives on when that node returns. A
simulator that returns drives from the start. Without the recorder or the view nothing happens to
the car. All bags can be read at the end, those of killed recorders after `recover`.
"""

from __future__ import annotations

import random
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING

from _figures import Figure, spread
from _nodes import Nodes, Witness
from rosbags.highlevel import AnyReader, AnyReaderError

from barc_sim.bags.recovery import recover
from barc_sim.errors import UserError
from barc_sim.ros.process import ros

if TYPE_CHECKING:
    import argparse
    from collections.abc import Callable

SHORT = 'each node once'
_SIMULATOR = 'vehicle_simulator'
_RECORDER = 'bag_recorder'
_VIEW = 'view'
_OBSERVERS = (_RECORDER, _VIEW)
#: By the node that commands, those that are killed first, in this order.
_FIRST_KILLS = {
    'controller': ('controller', _SIMULATOR, _RECORDER, _VIEW),
    'relay': ('relay', _RECORDER),
}
_KILLS = 50
_SHORT_KILLS = {'controller': 3, 'relay': 2}
_MIN_DRIVING_SPEED = 0.5  #: [m/s]
_MAX_STANDING_SPEED = 1e-6  #: [m/s]
_STANDSTILL_SHARE = 0.7  #: of the kills of a node that commands
_TIMEOUT = 30.0  #: [s]
_STATES = 25  #: to receive after the kill of a node that the car does not need


def soak(options: argparse.Namespace) -> list[Figure]:
    """Return the figures."""
    counts: Counter[str] = Counter()
    standing = []
    driving = []
    with tempfile.TemporaryDirectory() as name, ros([]):
        for commander in _FIRST_KILLS:
            ordeal = _Ordeal(Path(name, commander), commander, counts)
            ordeal.endure(_SHORT_KILLS[commander] if options.short else _KILLS)
            standing += ordeal.standing
            driving += ordeal.driving

    return [
        Figure('kills', counts['kills'], minimum=5 if options.short else 100),
        *spread('to a standstill without commands, s', standing, _TIMEOUT),
        *spread('from the start of a node until the car drives, s', driving, _TIMEOUT),
        Figure('what did not go on as it should', counts['faults'], maximum=0),
        Figure('exceptions', counts['exceptions'], maximum=0),
        Figure('nodes that did not end in order', counts['bad ends'], maximum=0),
        Figure('bags', counts['bags'], minimum=2),
        Figure('bags that cannot be read', counts['bad bags'], maximum=0),
    ]


class _Ordeal:
    """A run with one of the nodes that command, whose nodes are killed and started again."""

    def __init__(self, folder: Path, commander: str, counts: Counter[str]) -> None:
        folder.mkdir()
        self.standing: list[float] = []  #: [s] until the car stands
        self.driving: list[float] = []  #: [s] until the car drives
        self._folder = folder
        self._commander = commander
        self._counts = counts
        self._chance = random.Random(commander)  # noqa: S311 (no secret)
        self._nodes = Nodes(folder)
        self._witness = Witness()

    def endure(self, kills: int) -> None:
        """Start the nodes, kill and start them again, and end them."""
        names = (_SIMULATOR, *_OBSERVERS, self._commander)
        try:
            for name in names:
                self._nodes.start(name)
            self._wait_for('drives', self._drives)
            for name in _OBSERVERS:
                self._wait_for_starts(name, 1)

            first = _FIRST_KILLS[self._commander]
            for number in range(kills):
                name = first[number] if number < len(first) else self._chance.choice(names)
                self._kill_and_start(name)
        finally:
            codes = self._nodes.end()
            self._witness.destroy_node()

        self._counts['bad ends'] += sum(code != 0 for code in codes)
        self._look_at_logs()
        self._look_at_bags()

    def _kill_and_start(self, name: str) -> None:
        self._counts['kills'] += 1
        print(f'{self._counts["kills"]}: {name}', file=sys.stderr)
        self._nodes.kill(name)
        if name == self._commander and self._chance.random() < _STANDSTILL_SHARE:
            self.standing.append(self._wait_for('stands', self._stands))

        if name in _OBSERVERS:
            self._start_observer(name)
        elif name == _SIMULATOR:
            self._start_simulator()
        else:
            self._start_commander()

        self._spin(self._chance.uniform(0.0, 1.0))
        if not self._nodes.is_alive(name):
            self._count_fault(f'{name} has ended by itself')

    def _start_observer(self, name: str) -> None:
        starts = self._starts(name)
        self._nodes.start(name)
        self._wait_for_starts(name, starts + 1)

        states = self._witness.states
        self._wait_for(
            'goes on', lambda: self._witness.states > states + _STATES and self._drives()
        )

    def _start_simulator(self) -> None:
        # A state of the killed simulator, which has not been taken yet, is older than this.
        start = time.time_ns()
        self._nodes.start(_SIMULATOR)
        seconds = self._wait_for(
            'drives anew', lambda: self._witness.stamp > start and self._drives()
        )
        self.driving.append(seconds)

    def _start_commander(self) -> None:
        self._nodes.start(self._commander)
        seconds = self._wait_for(
            'drives again', lambda: self._witness.sees_commands() and self._drives()
        )
        self.driving.append(seconds)

    def _drives(self) -> bool:
        return self._witness.speed > _MIN_DRIVING_SPEED

    def _stands(self) -> bool:
        return abs(self._witness.speed) < _MAX_STANDING_SPEED

    def _starts(self, name: str) -> int:
        """Return how often an observer has started, by its bags, or by the links in its log."""
        if name == _RECORDER:
            return len(list(self._folder.glob('bags/*/*.mcap')))
        return self._nodes.logs().count('http://')

    def _wait_for_starts(self, name: str, count: int) -> None:
        self._wait_for(f'{name} is there', lambda: self._starts(name) >= count)

    def _wait_for(self, event: str, has_happened: Callable[[], bool]) -> float:
        """Return after how many seconds an event happened; count a fault where it did not."""
        start = time.monotonic()
        while not has_happened():
            if time.monotonic() - start > _TIMEOUT:
                self._count_fault(f'not come true: {event}')
                break
            self._witness.spin_once()
        return time.monotonic() - start

    def _spin(self, seconds: float) -> None:
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            self._witness.spin_once()

    def _count_fault(self, fault: str) -> None:
        self._counts['faults'] += 1
        print(fault, file=sys.stderr)

    def _look_at_logs(self) -> None:
        logs = self._nodes.logs()
        exceptions = logs.count('Traceback')
        self._counts['exceptions'] += exceptions
        if exceptions or self._counts['faults']:
            print(logs, file=sys.stderr)

    def _look_at_bags(self) -> None:
        for path in sorted((self._folder / 'bags').iterdir()):
            self._counts['bags'] += 1
            try:
                is_whole = self._is_whole(path)
            except (UserError, AnyReaderError) as error:
                is_whole = False
                print(f'{path}: {error}', file=sys.stderr)
            if not is_whole:
                self._counts['bad bags'] += 1

    def _is_whole(self, path: Path) -> bool:
        """Return whether a bag, recovered where it has to be, has all its messages."""
        bag = path
        if not (path / 'metadata.yaml').exists():
            bag = self._folder / f'{path.name} whole'
            recover(path, bag)
        with AnyReader([bag]) as reader:
            messages = sum(1 for _ in reader.messages())
            return messages == reader.message_count
