"""Environments for learning: steps per second of processor time, by number of cars.

Random actions, restarts included. One car is the single environment of `gymnasium.make`, beside
HighwayEnv's lane keeping and racetrack where that is installed (pip install highway-env); more cars
are one batch. The row of processes has one for each core, by the wall's clock: a batch in each, or
Gymnasium's AsyncVectorEnv with one car in each.
"""

from __future__ import annotations

from importlib.util import find_spec
from typing import TYPE_CHECKING, Any

from _compare import (
    Figures,
    Results,
    add_case,
    add_number,
    measure_in_turns,
    run_worker,
    table,
)

from barc_sim.errors import UserError

if TYPE_CHECKING:
    import argparse

_CARS = {'1 car': 1, '100 cars': 100, '1,000 cars': 1000, '10,000 cars': 10_000}
_CARS['100,000 cars'] = 100_000
_PROCESSES = 'Lane, processes'
_BARC_SIM: dict[str, tuple[str, dict[str, Any]]] = {
    'Lane, kinematic': ('barc_sim/Lane-v0', {}),
    'Lane, dynamic': ('barc_sim/Lane-v0', {'dynamics': 'dynamic'}),
    'Lane, noise': ('barc_sim/Lane-v0', {'noise': 0.1}),
    'Race, kinematic': ('barc_sim/Race-v0', {}),
    'Hills': ('barc_sim/Hills-v0', {}),
    _PROCESSES: ('barc_sim/Lane-v0', {}),
}
_HIGHWAY_ENV: dict[str, tuple[str, dict[str, Any]]] = {
    'HighwayEnv, lane keeping': ('lane-keeping-v0', {}),
    'HighwayEnv, racetrack': ('racetrack-v0', {}),
}
QUICK = ('--repeat', '1', '--seconds', '1', '--case', '1 car', '--case', '1,000 cars')


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    add_number(parser, '--repeat', 3, 'repetitions')
    add_number(parser, '--seconds', 3, 'of processor time for each measurement', 'S')
    add_case(parser, _CARS)


def measure(options: argparse.Namespace) -> Results:
    """Return the figures of each number of cars and environment, measured in turns."""
    if not find_spec('gymnasium'):
        raise UserError("Gymnasium is not installed: pip install 'barc_sim[gym]'")

    environments = _BARC_SIM
    if find_spec('highway_env'):
        environments = _BARC_SIM | _HIGHWAY_ENV
    subjects = {}
    for case in options.case or _CARS:
        subjects[case] = environments if _CARS[case] == 1 else _BARC_SIM

    def measure_once(case: str, name: str) -> Figures:
        environment, arguments = environments[name]
        return run_worker(
            '_learning.py',
            name=environment,
            options=arguments,
            cars=_CARS[case],
            processes=name == _PROCESSES,
            seconds=options.seconds,
        )

    return measure_in_turns(subjects, options.repeat, measure_once)


def report(results: Results) -> str:
    """Return a table."""
    text = table(results)
    if not find_spec('highway_env'):
        text += '\nHighwayEnv is compared, too: pip install highway-env'
    return text
