"""Drive for so many states into a folder; print how much memory a long drive takes [bytes]."""

from __future__ import annotations

import ctypes
import gc
import sys
import time
from pathlib import Path
from typing import Any

from barc_sim.run import main
from barc_sim.runs.car_monitor import CarMonitor
from barc_sim.runs.composition import Run

#: By then, all that a run keeps for good is there.
FIRST_STATE = 3000
last_state = int(sys.argv[1])
folder = sys.argv[2]

on_step_of_monitor = CarMonitor.on_step
init_of_run = Run.__init__
runs: list[Run] = []
memory: dict[int, int] = {}


def keep_run(run: Run, *arguments: Any) -> None:
    runs.append(run)
    init_of_run(run, *arguments)


def measure(monitor: CarMonitor, *arguments: Any) -> None:
    on_step_of_monitor(monitor, *arguments)
    states = monitor.simulator.stepper.states + 1
    if states in {FIRST_STATE, last_state}:
        wait_for_recorder(states)
        memory[states] = resident()
    if states == last_state:
        monitor.simulator.finish()


def wait_for_recorder(states: int) -> None:
    # What the recorder has not taken yet is a backlog, and no leak.
    while runs[0].bag.recorder.counts.get('/z_vhcl', 0) < states - 1:
        time.sleep(0.01)


def resident() -> int:
    # What a backlog has used and freed is not lost.
    gc.collect()
    ctypes.CDLL(None).malloc_trim(0)
    pages = Path('/proc/self/statm').read_text('ascii').split()[1]
    return int(pages) * 4096


CarMonitor.on_step = measure
Run.__init__ = keep_run
options = ['--road', 'flat', '--distance', '0', '--realtime-factor', 'max', '--bag-dir', folder]
code = main(['acc', '--quiet', *options])
print(memory[last_state] - memory[FIRST_STATE])
sys.exit(code)
