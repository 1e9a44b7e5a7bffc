"""10,000 messages a second, well-formed and malformed, on every topic that a node listens to.

From another process, once beside the cruise control and once beside a drive by hand, both with
recorder and live page.
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
_PATIENCE = 60.0  #: [s]
_MIB = 1 << 20
#: Beyond, the simulator refuses a command; faster, no such command can have made the car.
_SPEED = 200.0
_MOTOR = 100.0
_SERVO = 1.5
#: [MiB] after the first third; the recorder's and the page's buffers breathe.
_GROWTH = 30.0


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
    flooded, flood = _meet(mode, rate, seconds)
    late = 100.0 * int(flooded['missed_deadlines']) / int(flooded['steps'])
    held = flooded['memory'][len(flooded['memory']) // 3 :]
    sent = flood['sent'] / flood['seconds']
    figures = [
        Figure('messages sent, 1/s', sent, least=0.95 * rate if in_time else 1.0),
        Figure('messages recorded', flooded['recorded']),
        Figure('of them not in the bag', flooded['recorded'] - flooded['held'], most=0, least=0),
        Figure('messages that the recorder lost and counted', int(flooded['lost_messages'])),
        Figure('steps', int(flooded['steps']), least=1),
        # A machine that tests share is late for reasons of its own.
        Figure('missed deadlines, %', late, most=1.0 if in_time else 75.0),
        Figure('periods that the clock slipped', int(flooded['slipped_periods'])),
        Figure('states that are not finite', flooded['not_finite'], most=0),
        Figure('greatest speed, m/s', flooded['speed'], most=_SPEED),
        Figure('greatest acceleration, m/s²', flooded['motor'], most=_MOTOR),
        Figure('greatest steering, rad', flooded['servo'], most=_SERVO),
        Figure('memory at the end, MiB', held[-1] / _MIB),
        Figure('its growth in the last two thirds, MiB', (max(held) - held[0]) / _MIB, _GROWTH),
        Figure('exceptions', flooded['stderr'].count('Traceback'), most=0),
    ]
    return [figure._replace(name=f'{mode}: {figure.name}') for figure in figures]


def _meet(mode: str, rate: float, seconds: float) -> tuple[dict[str, Any], dict[str, float]]:
    """Return what became of the run, and of the flood."""
    task = json.dumps({'mode': mode, 'rate': rate, 'seconds': seconds, 'seed': 1})
    with tempfile.TemporaryDirectory() as folder:
        options = ['--bag-dir', folder, '--view', 'web', '--quiet']
        if mode == 'acc':
            options += ['--distance', '0', '--road', 'flat']
        run = _start('_flooded.py', mode, *options)
        flooder = _start('_flooder.py', task)
        try:
            flood = _answer(flooder, seconds + _PATIENCE)
            run.send_signal(signal.SIGINT)
            flooded = _answer(run, _PATIENCE)
        finally:
            for process in (run, flooder):
                process.kill()
                process.communicate()
        path = bag.newest(folder)
        with AnyReader([path]) as reader:
            held = sum(1 for _ in reader.messages())
            counts = {'recorded': reader.message_count, 'held': held}
        # A bag that is not whole lacks the number of steps.
        return {**flooded, **counts, **bag.info(path)}, flood


def _start(program: str, *arguments: str) -> subprocess.Popen[str]:
    return subprocess.Popen(  # noqa: S603 (our own)
        [sys.executable, str(_HERE / program), *arguments],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def _answer(process: subprocess.Popen[str], patience: float) -> dict[str, Any]:
    try:
        out, err = process.communicate(timeout=patience)
    except subprocess.TimeoutExpired:
        raise UserError(f'{process.args!r} has not ended after {patience:g} s') from None
    if process.returncode or not out:
        raise UserError(f'{process.args!r} ended with code {process.returncode}: {err}')
    if 'Traceback' in err:
        print(err[err.index('Traceback') :], file=sys.stderr)
    return {**json.loads(out.splitlines()[-1]), 'stderr': err}
