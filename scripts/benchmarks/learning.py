"""Environments for learning: steps per second of processor time, by number of cars.

Random actions, restarts included. One car is the single environment of `gymnasium.make`, beside
HighwayEnv's lane keeping and racetrack where that is installed (pip install highway-env); more cars
are one batch. The row of processes has one for each core, by the wall's clock: a batch in each, or
Gymnasium's AsyncVectorEnv with one car in each.
"""

from __future__ import annotations

from importlib.util import find_spec
from typing import TYPE_CHECKING, Any

from _compare import Found, add_case, add_number, in_turns, measured, table

from barc_sim.errors import UserError

if TYPE_CHECKING:
    import argparse

_CARS = {'1 car': 1, '100 cars': 100, '1,000 cars': 1000, '10,000 cars': 10_000}
_CARS['100,000 cars'] = 100_000
_PROCESSES = 'Lane, processes'
_OURS: dict[str, tuple[str, dict[str, Any]]] = {
    'Lane, kinematic': ('barc_sim/Lane-v0', {}),
    'Lane, dynamic': ('barc_sim/Lane-v0', {'dynamics': 'dynamic'}),
    'Lane, noise': ('barc_sim/Lane-v0', {'noise': 0.1}),
    'Race, kinematic': ('barc_sim/Race-v0', {}),
    'Hills': ('barc_sim/Hills-v0', {}),
    _PROCESSES: ('barc_sim/Lane-v0', {}),
}
_THEIRS: dict[str, tuple[str, dict[str, Any]]] = {
    'HighwayEnv, lane keeping': ('lane-keeping-v0', {}),
    'HighwayEnv, racetrack': ('racetrack-v0', {}),
}
QUICK = ('--repeat', '1', '--seconds', '1', '--case', '1 car', '--case', '1,000 cars')


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    add_number(parser, '--repeat', 3, 'repetitions')
    add_number(parser, '--seconds', 3, 'of processor time for each measurement', 'S')
    add_case(parser, _CARS)


def measure(options: argparse.Namespace) -> Found:
    """Return the figures of each number of cars and environment, measured in turns."""
    if not find_spec('gymnasium'):
        raise UserError("Gymnasium is not installed: pip install 'barc_sim[gym]'")
    theirs = _THEIRS if find_spec('highway_env') else {}
    subjects = {**_OURS, **theirs}
    return in_turns(
        {case: [*(subjects if _CARS[case] == 1 else _OURS)] for case in options.case or _CARS},
        options.repeat,
        lambda case, name: measured(
            '_learning.py',
            name=subjects[name][0],
            options=subjects[name][1],
            cars=_CARS[case],
            processes=name == _PROCESSES,
            seconds=options.seconds,
        ),
    )


def report(found: Found) -> str:
    """Return a table."""
    hint = (
        '' if find_spec('highway_env') else '\nHighwayEnv is compared, too: pip install highway-env'
    )
    return table(found) + hint
