"""A run that watches itself until SIGINT; prints, as JSON, what became of it."""

from __future__ import annotations

import json
import sys
from math import isfinite
from typing import TYPE_CHECKING

from _memory import memory

from barc_sim import run
from barc_sim.cruise_control import CruiseControl
from barc_sim.executor import QuickExecutor
from barc_sim.process import NUM_THREADS, ros
from barc_sim.signals import StopSignals
from barc_sim.teleop import Teleop

if TYPE_CHECKING:
    from argparse import Namespace

    from barc_sim.composition import Run
    from barc_sim.plant import Observation

_EVERY = 25  #: steps from one look at the memory to the next


class _Watch:
    """What is kept of all states."""

    def __init__(self) -> None:
        self.steps = self.not_finite = 0
        self.speed = self.motor = self.servo = 0.0
        self.memory: list[int] = []

    def see(self, seen: Observation) -> None:
        self.steps += 1
        self.not_finite += not all(map(isfinite, (*seen.true, *seen.acting)))
        self.speed = max(self.speed, abs(seen.true.v_x))
        self.motor = max(self.motor, abs(seen.acting.motor))
        self.servo = max(self.servo, abs(seen.acting.servo))
        if self.steps % _EVERY == 0:
            self.memory.append(memory())


class _CruiseControl(CruiseControl):
    def __init__(self, options: Namespace, argv: list[str]) -> None:
        self.watch = _Watch()
        super().__init__(options, argv)

    def on_step(self, t: float, seen: Observation) -> None:
        super().on_step(t, seen)
        self.watch.see(seen)


class _Teleop(Teleop):
    def __init__(self, options: Namespace, argv: list[str]) -> None:
        self.watch = _Watch()
        super().__init__(options, argv, None)

    def on_step(self, t: float, seen: Observation) -> None:
        super().on_step(t, seen)
        self.watch.see(seen)


def main() -> None:
    """Run the command line."""
    argv = sys.argv[1:]
    options = run.parser().parse_args(argv)
    with StopSignals() as stop, ros(['--ros-args', '--log-level', 'error']):
        drive = (_Teleop if options.mode == 'teleop' else _CruiseControl)(options, argv)
        drive.spin(stop, QuickExecutor(num_threads=NUM_THREADS))
        drive.close()
    print(json.dumps(_figures(drive, drive.watch)))


def _figures(drive: Run, watch: _Watch) -> dict[str, object]:
    assert drive.recorder  # noqa: S101 (no --no-bag)
    return {
        **vars(watch),
        'missed': drive.missed,
        'slipped': drive.slipped,
        'refused': drive.simulator.refused,
        'recorded': sum(drive.recorder.counts.values()),
        'lost': sum(sum(by.values()) for by in drive.recorder.lost.values() if by),
        'bag': str(drive.recorder.path),
    }


if __name__ == '__main__':
    main()
