"""10,000 messages a second, well-formed and malformed, on every topic that a node subscribes to.

They come from another process, once beside the cruise control and once beside a drive by hand,
both with recorder and live page.
"""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Any

from _figures import Figure
from rosbags.highlevel import AnyReader

from barc_sim.bags import reader as bag
from barc_sim.cli.parser import whole
from barc_sim.errors import UserError

if TYPE_CHECKING:
    import argparse

SHORT = '3 s of it, and any speed will do'
_HERE = Path(__file__).parent
_MODES = ('acc', 'teleop')
_END_TIMEOUT = 60.0  #: [s]
_MIB = 1 << 20
#: The simulator refuses larger commands, and no smaller one makes the car faster.
_MAX_SPEED = 200.0  #: [m/s]
_MAX_MOTOR = 100.0  #: [m/s²]
_MAX_SERVO = 1.5  #: [rad]
#: [MiB] after the first third; the recorder's and the page's buffers grow and shrink.
_MAX_GROWTH = 30.0


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    parser.add_argument('--rate', type=whole(1), default=10_000, help='messages per second (10000)')
    parser.add_argument('--mode', choices=_MODES, action='append', help='only beside this run')


def soak(options: argparse.Namespace) -> list[Figure]:
    """Return the figures of both runs."""
    seconds = 3.0 if options.short else 60.0
    figures = []
    for mode in options.mode or _MODES:
        print(f'{mode}: {seconds:g} s', file=sys.stderr)
        figures += _figures(mode, options.rate, seconds, in_time=not options.short)
    return figures


def _figures(mode: str, rate: float, seconds: float, *, in_time: bool) -> list[Figure]:
    """Return the figures of a run; `in_time`: the machine has to be fast, too."""
    run, flood = _meet(mode, rate, seconds)
    late = 100.0 * int(run['missed_deadlines']) / int(run['steps'])
    memory = run['memory'][len(run['memory']) // 3 :]
    growth = max(memory) - memory[0]
    sent_rate = flood['messages'] / flood['seconds']
    not_in_bag = run['recorded'] - run['in_bag']

    figures = [
        Figure('messages sent, 1/s', sent_rate, minimum=0.95 * rate if in_time else 1.0),
        Figure('messages recorded', run['recorded']),
        Figure('of them not in the bag', not_in_bag, maximum=0, minimum=0),
        Figure('messages that the recorder lost and counted', int(run['lost_messages'])),
        Figure('steps', int(run['steps']), minimum=1),
        # A machine that tests share is late for reasons of its own.
        Figure('missed deadlines, %', late, maximum=1.0 if in_time else 75.0),
        Figure('periods that the clock slipped', int(run['slipped_periods'])),
        Figure('states that are not finite', run['not_finite'], maximum=0),
        Figure('greatest speed, m/s', run['speed'], maximum=_MAX_SPEED),
        Figure('greatest acceleration, m/s²', run['motor'], maximum=_MAX_MOTOR),
        Figure('greatest steering, rad', run['servo'], maximum=_MAX_SERVO),
        Figure('memory at the end, MiB', memory[-1] / _MIB),
        Figure('its growth in the last two thirds, MiB', growth / _MIB, _MAX_GROWTH),
        Figure('exceptions', run['stderr'].count('Traceback'), maximum=0),
    ]
    return [figure._replace(name=f'{mode}: {figure.name}') for figure in figures]


def _meet(mode: str, rate: float, seconds: float) -> tuple[dict[str, Any], dict[str, float]]:
    """Return what the run and its bag have at the end, and what the flood has sent."""
    task = json.dumps({'mode': mode, 'rate': rate, 'seconds': seconds, 'seed': 1})
    with tempfile.TemporaryDirectory() as folder:
        options = ['--bag-dir', folder, '--view', 'web', '--quiet']
        if mode == 'acc':
            options += ['--distance', '0', '--road', 'flat']
        run = _start('_flooded.py', mode, *options)
        flooder = _start('_flooder.py', task)

        try:
            flood = _answer(flooder, seconds + _END_TIMEOUT)
            run.send_signal(signal.SIGINT)
            answer = _answer(run, _END_TIMEOUT)
        finally:
            for process in (run, flooder):
                process.kill()
                process.communicate()
        return {**answer, **_bag_facts(folder)}, flood


def _bag_facts(folder: str) -> dict[str, Any]:
    path = bag.newest(folder)
    with AnyReader([path]) as reader:
        messages = sum(1 for _ in reader.messages())
        counts = {'recorded': reader.message_count, 'in_bag': messages}
    # A bag that is not whole lacks the number of steps.
    return {**counts, **bag.info(path)}


def _start(program: str, *arguments: str) -> subprocess.Popen[str]:
    return subprocess.Popen(  # noqa: S603 (our own)
        [sys.executable, str(_HERE / program), *arguments],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def _answer(process: subprocess.Popen[str], timeout: float) -> dict[str, Any]:
    """Return what a process prints last, as JSON, with its `stderr`."""
    try:
        out, err = process.communicate(timeout=timeout)
    except subprocess.TimeoutExpired:
        raise UserError(f'{process.args!r} has not ended after {timeout:g} s') from None

    if process.returncode or not out:
        raise UserError(f'{process.args!r} ended with code {process.returncode}: {err}')
    if 'Traceback' in err:
        print(err[err.index('Traceback') :], file=sys.stderr)
    return {**json.loads(out.splitlines()[-1]), 'stderr': err}
