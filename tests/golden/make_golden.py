"""Golden figures: what runs produce, to the last bit, in a few lines for each.

`golden.json` beside this file holds the figures of commit ee8f010. Later are those of
`applied_command`, of runs with noise, since it comes from NumPy's PCG64, and of the dynamic bicycle
with steering, since it takes square roots in place of `math.hypot`. To make them again, run this
module with the Python of the checkout that they are to describe::

    PYTHONPATH=tests .venv/bin/python -m golden.make_golden FILE

For each run by the command line the figures are its metadata and, for each topic of its bag, type,
number of messages and a hash of the values of each field. Left out is what differs from run to run:
wall time, and what /rosout and /parameter_events carry.
The bag is read by `rosbags`, so that the figures do not depend on the package's own reader.
"""

from __future__ import annotations

import json
import math
import os
import signal
import struct
import subprocess
import sys
import tempfile
from dataclasses import fields, is_dataclass
from hashlib import sha256
from pathlib import Path
from typing import TYPE_CHECKING, Any

import yaml
from command_line import ENVIRONMENT, started
from golden import drivers, loops
from golden.scenarios import SCENARIOS
from rosbags.highlevel import AnyReader

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence

    from golden.scenarios import Scenario

    Topics = dict[str, list[Any]]  # messages by the name of their topic

GOLDEN = Path(__file__).with_name('golden.json')
_LEFT_OUT = ('/rosout', '/parameter_events')
#: Values of the metadata that differ between machines, versions and command lines.
_UNPINNED = ('barc_sim', 'command', 'graph', 'parameters', 'platform', 'python')
#: In a run by hand also those that tell how long it took.
_COUNTED = ('missed_deadlines', 'slipped_periods', 'steps')
#: States of a run by hand, from the last one at rest.
_STATES_BY_HAND = 150
_NANOSECONDS = 10**9


def figures(
    scenario: Scenario, folder: Path, run: Callable[[Scenario, Path], object] | None = None
) -> dict[str, str]:
    """Make the run in the empty `folder`, by default in a process; return its bag's figures."""
    for name, text in scenario.files.items():
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_text(text, encoding='utf-8')
    (run or _run)(scenario, folder)
    (bag,) = (folder / 'bags').iterdir()
    with AnyReader([bag]) as reader:
        types = {connection.topic: connection.msgtype for connection in reader.connections}
        topics: Topics = {topic: [] for topic in types if topic not in _LEFT_OUT}
        recorded_topics = [each for each in reader.connections if each.topic in topics]
        for connection, _, data in reader.messages(recorded_topics):
            topics[connection.topic].append(reader.deserialize(data, connection.msgtype))
    described = yaml.safe_load((bag / 'metadata.yaml').read_text(encoding='utf-8'))
    metadata = described['rosbag2_bagfile_information']['custom_data']
    unpinned = _UNPINNED
    if scenario.mode == 'teleop':
        topics, unpinned = _from_the_start(topics), (*_UNPINNED, *_COUNTED)
    pinned = {name: '*' if name in unpinned else value for name, value in metadata.items()}
    return {'metadata': ' '.join(f'{name}={value}' for name, value in sorted(pinned.items()))} | {
        topic: ' '.join([kind, *_figures(_columns(topics[topic], _start(topic, topics)))])
        if topic in topics
        else kind
        for topic, kind in sorted(types.items())
    }


def loop_figures(name: str) -> dict[str, str]:
    """Return the figures of a loop without ROS."""
    return {'log': ' '.join(_figures(loops.columns(name)))}


def _figures(columns: Mapping[str, Sequence[float]]) -> list[str]:
    """Return the number of rows, and each column's name with a hash of its values' bits."""
    rows = {len(values) for values in columns.values()}
    hashes = [f'{name}:{figure(values)}' for name, values in columns.items()]
    return [*map(str, rows), *hashes]


def figure(values: Sequence[float]) -> str:
    """Return the first 8 digits of the SHA-256 of the values, each as a little-endian float64."""
    return sha256(struct.pack(f'<{len(values)}d', *values)).hexdigest()[:8]


def libm() -> str:
    """Return a hash of what this machine's mathematical functions give.

    C libraries and processors differ in the last bit of a sine, and with it in all that follows.
    """
    points = [k / 64 + 1 / 3 for k in range(1, 2000)]
    functions = (math.sin, math.cos, math.tan, math.atan, math.log, math.exp, math.expm1)
    values = [function(point) for function in functions for point in points]
    values += [function(point / 1000) for function in functions for point in points]
    return figure(values)


def _run(scenario: Scenario, folder: Path) -> None:
    """Run the command line to its end.

    Raises
    ------
    RuntimeError
        where it fails, or does not end: then with the place of each thread.
    """
    env = os.environ | ENVIRONMENT | {'PYTHONFAULTHANDLER': '1'}
    with started(*scenario.arguments(), cwd=folder, env=env, stderr=subprocess.STDOUT) as process:
        if scenario.driver:
            drivers.drive(scenario.driver, process)
        try:
            output, _ = process.communicate(timeout=drivers.TIMEOUT)
        except subprocess.TimeoutExpired:
            process.send_signal(signal.SIGABRT)
            output, _ = process.communicate()
    if process.returncode:
        raise RuntimeError(f'{scenario} ended with {process.returncode}: {output}')


def _from_the_start(topics: Topics) -> Topics:
    """Return the part of a run by hand that does not depend on the wall clock.

    It begins with the last state at rest and has a fixed number of states. Commands bear no
    stamp, and as many are published as there is time for: of those, and of `cmd_vel`, only the
    first that is not zero is kept.
    """
    states = topics['/z_vhcl']
    begin = next(k for k, state in enumerate(states) if state.v_x) - 1
    stamps = {_stamp(state) for state in states[begin : begin + _STATES_BY_HAND]}
    later: Topics = {}
    for topic, messages in topics.items():
        if topic in ('/ecu', '/cmd_vel'):
            moving = (message for message in messages if any(v for _, v in _numbers(message)))
            later[topic] = [next(moving)]
        else:
            later[topic] = [message for message in messages if _stamp(message) in stamps]
    return later


def _start(topic: str, topics: Topics) -> int:
    """Return the stamp [ns] of the first state of the car that `topic` is of.

    A topic of no car, as /clock, goes with the first car.
    """
    states = topic.rpartition('/')[0] + '/z_vhcl'
    if states not in topics:
        states = min(name for name in topics if name.endswith('/z_vhcl'))
    return _stamp(topics[states][0])


def _columns(messages: list[Any], first: int) -> dict[str, list[float]]:
    """Return the values of each field; stamps [ns] are relative to `first`, the first state's."""
    columns: dict[str, list[float]] = {}
    for message in messages:
        stamp = _stamp(message)
        row = [('stamp', float(stamp - first))] if stamp else []
        for name, value in (*row, *_numbers(message)):
            columns.setdefault(name, []).append(value)
    return columns


def _stamp(message: Any) -> int:  # noqa: ANN401 (of any type)
    """Return the message's stamp [ns]; 0 where it has none."""
    time = getattr(getattr(message, 'header', message), 'stamp', getattr(message, 'clock', None))
    return time.sec * _NANOSECONDS + time.nanosec if time else 0


def _numbers(message: Any, prefix: str = '') -> Iterator[tuple[str, float]]:  # noqa: ANN401
    """Yield the names and values of a message's fields but for its stamp, as `linear.x`."""
    for field in fields(message):
        value = getattr(message, field.name)
        if field.name in ('header', 'clock') or field.name.startswith('__'):
            continue
        if is_dataclass(value):
            yield from _numbers(value, f'{prefix}{field.name}.')
        else:
            yield prefix + field.name, float(value)


def differences(expected: Mapping[str, str], actual: Mapping[str, str]) -> list[str]:
    """Return a line for each topic that differs: what was expected alone, and what was found."""
    return [
        f'{name}: expected {sorted(old - new)}, found {sorted(new - old)}'
        for name in sorted(expected.keys() | actual.keys())
        if (old := {*expected.get(name, '').split()}) != (new := {*actual.get(name, '').split()})
    ]


def main(arguments: Iterable[str]) -> None:
    """Write the figures of every run into the file that is named."""
    (file,) = arguments
    os.environ.setdefault('ROS_DOMAIN_ID', '61')
    os.environ.setdefault('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    golden: dict[str, Any] = {'libm': libm()}
    for name, scenario in SCENARIOS.items():
        with tempfile.TemporaryDirectory() as folder:
            golden[name] = figures(scenario, Path(folder))
    golden |= {name: loop_figures(name) for name in loops.LOOPS}
    Path(file).write_text(json.dumps(golden, indent=1) + '\n', encoding='utf-8')


if __name__ == '__main__':
    main(sys.argv[1:])
