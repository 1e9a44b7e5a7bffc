"""Each node killed with -9 and started again, 100 times at random: the run goes on.

The simulator, the controller, the relay, the recorder and the view run in processes of their own,
half of the time with the controller, and half with the relay in its place. Without the one that
commands the car brakes to a standstill, and drives on when it returns; a simulator that returns
drives from the start; without the recorder or the view nothing happens to the car. All bags can be
read at the end, those of killed recorders after `recover`.
"""

from __future__ import annotations

import random
import sys
import tempfile
import time
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from _figures import Figure, spread
from _nodes import Nodes, Witness
from rosbags.highlevel import AnyReader, AnyReaderError

from barc_sim.bags.convert import recover
from barc_sim.errors import UserError
from barc_sim.ros.process import ros

if TYPE_CHECKING:
    import argparse
    from collections.abc import Callable

SHORT = 'each node once'
_COMMANDERS = ('controller', 'relay')
_OTHERS = ('vehicle_simulator', 'bag_recorder', 'view')
_MOVING = 0.5  #: [m/s]
_STANDING = 1e-6  #: [m/s]
_PATIENCE = 30.0  #: [s]
_STATES = 25  #: to receive after the kill of a node that the car does not need


def soak(options: argparse.Namespace) -> list[Figure]:
    """Return the figures."""
    kills = 3 if options.short else 50
    with tempfile.TemporaryDirectory() as name, ros([]):
        ordeals = [_Ordeal(Path(name, commander), commander) for commander in _COMMANDERS]
        for number, ordeal in enumerate(ordeals):
            ordeal.endure(kills - (number if options.short else 0))
        killed = sum(ordeal.killed for ordeal in ordeals)
        return [
            Figure('kills', killed, least=5 if options.short else 100),
            *spread('to a standstill without commands, s', _all(ordeals, 'standing'), _PATIENCE),
            *spread(
                'from the start of a node until the car drives, s',
                _all(ordeals, 'driving'),
                _PATIENCE,
            ),
            Figure('what did not go on as it should', sum(o.faults for o in ordeals), most=0),
            Figure('exceptions', sum(o.exceptions for o in ordeals), most=0),
            Figure('nodes that did not end in order', sum(o.bad_ends for o in ordeals), most=0),
            Figure('bags', sum(o.bags for o in ordeals), least=2),
            Figure('bags that cannot be read', sum(o.bad_bags for o in ordeals), most=0),
        ]


def _all(ordeals: list[_Ordeal], name: str) -> list[float]:
    return [value for ordeal in ordeals for value in getattr(ordeal, name)]


class _Ordeal:
    """A run with one of the nodes that command."""

    def __init__(self, folder: Path, commander: str) -> None:
        folder.mkdir()
        self._folder = folder
        self._commander = commander
        self._nodes = Nodes(folder)
        self._chance = random.Random(commander)  # noqa: S311 (no secret)
        self.killed = self.faults = self.exceptions = self.bad_ends = self.bags = self.bad_bags = 0
        self.standing: list[float] = []
        self.driving: list[float] = []

    def endure(self, kills: int) -> None:
        """Start, kill and start again, and end."""
        names = (*_OTHERS, self._commander)
        self._witness = Witness()
        try:
            for name in names:
                self._nodes.start(name)
            self._expect('drives', self._drives)
            for name in _OTHERS[1:]:
                self._expect(f'{name} is there', partial(self._signs, name))
            # Each once, and then as it comes.
            first = (
                [self._commander, *_OTHERS]
                if self._commander == _COMMANDERS[0]
                else [self._commander, 'bag_recorder']
            )
            for number in range(kills):
                name = first[number] if number < len(first) else self._chance.choice(names)
                self._kill(name)
        finally:
            self.bad_ends = sum(code != 0 for code in self._nodes.end())
            self._witness.destroy_node()
        said = self._nodes.logs()
        self.exceptions = said.count('Traceback')
        if self.faults or self.exceptions:
            print(said, file=sys.stderr)
        self._look_at_bags()

    def _kill(self, name: str) -> None:
        print(f'{self.killed + 1}: {name}', file=sys.stderr)
        self._nodes.kill(name)
        self.killed += 1
        if name == self._commander and self._chance.random() < 0.7:  # noqa: PLR2004
            self.standing.append(self._expect('stands', self._stands))
        # A state of the simulator before, not yet taken, is older than this.
        began = time.time_ns()
        signs = self._signs(name)
        self._nodes.start(name)
        if name in _COMMANDERS:
            self.driving.append(
                self._expect('drives again', lambda: self._witness.commanded() and self._drives())
            )
        elif name == 'vehicle_simulator':
            self.driving.append(
                self._expect('drives anew', lambda: self._witness.stamp > began and self._drives())
            )
        else:
            self._expect(f'{name} is there', lambda: self._signs(name) > signs)
            states = self._witness.states
            self._expect(
                'goes on', lambda: self._witness.states > states + _STATES and self._drives()
            )
        self._pause(self._chance.uniform(0.0, 1.0))
        if not self._nodes.alive(name):
            self.faults += 1
            print(f'{name} has ended by itself', file=sys.stderr)

    def _signs(self, name: str) -> int:
        """Return how often a node has started: its bags, or the links in its log."""
        if name == 'bag_recorder':
            return len(list(self._folder.glob('bags/*/*.mcap')))
        return self._nodes.logs().count('http://')

    def _drives(self) -> bool:
        return self._witness.speed > _MOVING

    def _stands(self) -> bool:
        return abs(self._witness.speed) < _STANDING

    def _expect(self, what: str, come: Callable[[], object]) -> float:
        """Return after how many seconds it has come; count a fault where it does not."""
        began = time.monotonic()
        while not come():
            if time.monotonic() - began > _PATIENCE:
                self.faults += 1
                print(f'not come true: {what}', file=sys.stderr)
                break
            self._witness.turn()
        return time.monotonic() - began

    def _pause(self, seconds: float) -> None:
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            self._witness.turn()

    def _look_at_bags(self) -> None:
        for path in sorted((self._folder / 'bags').iterdir()):
            self.bags += 1
            whole = path
            try:
                if not (path / 'metadata.yaml').exists():
                    whole = self._folder / f'{path.name} whole'
                    recover(path, whole)
                with AnyReader([whole]) as reader:
                    held = sum(1 for _ in reader.messages())
                    self.bad_bags += held != reader.message_count
            except (UserError, AnyReaderError) as error:
                self.bad_bags += 1
                print(f'{path}: {error}', file=sys.stderr)
