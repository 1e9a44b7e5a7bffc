"""The live page beside the cruise-control run: timing of its steps, processor time, states shown.

The lab's course is driven in real time, with the recorder on, in a process of its own: without the
page's node, with it and nobody looking, with a page that only counts what arrives, and with a real
one in headless Chromium, which draws without a graphics card and so takes a core for itself.
"""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
import tempfile
import time
from typing import TYPE_CHECKING, Any
from urllib.parse import urlsplit

from _compare import Found, add_number, in_turns, measured, table

if TYPE_CHECKING:
    import argparse
    from argparse import Namespace

_CHROMIUM = shutil.which('chromium') or shutil.which('chromium-browser')
_FLAGS = (
    '--headless',
    '--no-sandbox',
    '--disable-gpu',
    '--disable-quic',
    '--no-first-run',
    '--disable-background-networking',
    '--disable-component-update',
    '--disable-sync',
    '--remote-debugging-port=0',
)
_CASES = ('no view', 'nobody looks', 'a page counts', 'Chromium draws')
QUICK = ('--repeat', '1', '--distance', '5')


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    add_number(parser, '--repeat', 3, 'repetitions')
    add_number(parser, '--distance', 180, 'length of a run', 'M')


def measure(options: Namespace) -> Found:
    """Return the figures of each case, a list of one per repetition."""
    return in_turns(
        {'the run': _CASES if _CHROMIUM else _CASES[:-1]},
        options.repeat,
        lambda _, case: measured('view.py', case=case, distance=options.distance),
    )


def report(found: Found) -> str:
    """Return a table."""
    return table(found, ratio=False)


def _drive(task: dict[str, Any]) -> dict[str, float]:
    """Drive once, in this process; return the figures."""
    from _timed import TimedRun  # noqa: PLC0415

    from barc_sim.cli.process import StopSignals  # noqa: PLC0415
    from barc_sim.nodes.view import ViewNode  # noqa: PLC0415
    from barc_sim.ros.process import ros  # noqa: PLC0415

    case = task['case']
    words = ['--distance', str(task['distance'])]
    with tempfile.TemporaryDirectory() as folder, ros([]), StopSignals() as stop:
        run = TimedRun('--bag-dir', folder, *words)
        view = None if case == _CASES[0] else run.run.add(ViewNode)
        page = _open(case, view.url, folder) if view else None
        run.spin(stop)
        timing = run.timing()
        shown = _shown(page)
    return {**timing, 'states/s at the page': shown}


def _open(case: str, url: str, folder: str) -> subprocess.Popen[str] | None:
    if case == _CASES[1]:
        return None
    if case == _CASES[2]:
        command = [sys.executable, __file__, json.dumps({'url': url})]
    else:
        command = [str(_CHROMIUM), *_FLAGS, f'--user-data-dir={folder}/chromium', url]
    page = subprocess.Popen(  # noqa: S603 (this file, or Chromium)
        command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True
    )
    time.sleep(3.0)  # its start is no part of the run
    return page


def _shown(page: subprocess.Popen[str] | None) -> float:
    """End the page; return how many states a second it counted, NaN if it counts none."""
    if page is None:
        return float('nan')
    if page.args[0] != sys.executable:  # type: ignore[index]
        page.terminate()
    said, _ = page.communicate()
    return float(said or 'nan')


def _count(url: str) -> float:
    """Return how many states a second arrive at a page, until it is closed."""
    from websockets.exceptions import ConnectionClosed  # noqa: PLC0415 (the worker only)
    from websockets.sync.client import connect  # noqa: PLC0415

    from barc_sim.page.protocol import COLUMNS  # noqa: PLC0415

    address = urlsplit(url)
    first = last = 0.0
    rows = 0
    with connect(f'ws://{address.netloc}{address.path}socket', proxy=None) as socket:
        try:
            while True:
                data = socket.recv()
                if isinstance(data, bytes) and data:
                    last = time.perf_counter()
                    if first:
                        rows += len(data) // (8 * len(COLUMNS))
                    first = first or last
        except ConnectionClosed:
            return rows / (last - first)


if __name__ == '__main__':
    task = json.loads(sys.argv[1])
    print(json.dumps(_drive(task) if 'case' in task else _count(task['url'])))
