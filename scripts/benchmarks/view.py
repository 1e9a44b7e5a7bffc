"""The live page beside the cruise-control run: timing of its steps, processor time, states shown.

The lab's course is driven in real time, with the recorder on, in a process of its own: without the
page's node, with it and nobody looking, with a page that only counts what arrives, and with a real
one in headless Chromium, which draws without a graphics card and needs a core of its own.
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

from _compare import Figures, Results, add_number, measure_in_turns, run_worker, table

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
_NO_VIEW = 'no view'
_NOBODY_LOOKS = 'nobody looks'
_PAGE_COUNTS = 'a page counts'
_CHROMIUM_DRAWS = 'Chromium draws'
_CASES = (_NO_VIEW, _NOBODY_LOOKS, _PAGE_COUNTS, _CHROMIUM_DRAWS)
QUICK = ('--repeat', '1', '--distance', '5')


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    add_number(parser, '--repeat', 3, 'repetitions')
    add_number(parser, '--distance', 180, 'length of a run', 'M')


def measure(options: Namespace) -> Results:
    """Return the figures of each case, a list of one per repetition."""
    cases = [case for case in _CASES if _CHROMIUM or case != _CHROMIUM_DRAWS]

    def measure_once(_: str, case: str) -> Figures:
        return run_worker('view.py', case=case, distance=options.distance)

    return measure_in_turns({'the run': cases}, options.repeat, measure_once)


def report(results: Results) -> str:
    """Return a table."""
    return table(results, ratio=False)


def _drive(task: dict[str, Any]) -> dict[str, float]:
    """Drive once, in this process; return the figures."""
    from _timed import TimedRun  # noqa: PLC0415

    from barc_sim.cli.process import StopSignals  # noqa: PLC0415
    from barc_sim.nodes.view import ViewNode  # noqa: PLC0415
    from barc_sim.ros.process import ros  # noqa: PLC0415

    case = task['case']
    distance = str(task['distance'])
    with tempfile.TemporaryDirectory() as folder, ros([]), StopSignals() as stop:
        run = TimedRun('--bag-dir', folder, '--distance', distance)
        page = None
        if case != _NO_VIEW:
            view = run.run.add(ViewNode)
            page = _open_page(case, view.url, folder)

        run.spin(stop)
        timing = run.timing()
        rate = _close_page(page)
    return {**timing, 'states/s at the page': rate}


def _open_page(case: str, url: str, folder: str) -> subprocess.Popen[str] | None:
    if case == _NOBODY_LOOKS:
        return None

    if case == _CHROMIUM_DRAWS:
        command = [str(_CHROMIUM), *_FLAGS, f'--user-data-dir={folder}/chromium', url]
    else:
        command = [sys.executable, __file__, json.dumps({'url': url})]
    page = subprocess.Popen(  # noqa: S603 (this file, or Chromium)
        command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True
    )
    time.sleep(3.0)  # its start is no part of the run
    return page


def _close_page(page: subprocess.Popen[str] | None) -> float:
    """End the page; return how many states a second it counted, NaN if it counts none."""
    if page is None:
        return float('nan')
    if page.args[0] != sys.executable:  # type: ignore[index]
        page.terminate()
    text, _ = page.communicate()
    return float(text or 'nan')


def _count(url: str) -> float:
    """Return how many states a second arrive at a page, until it is closed."""
    from websockets.exceptions import ConnectionClosed  # noqa: PLC0415 (the worker only)
    from websockets.sync.client import connect  # noqa: PLC0415

    from barc_sim.page.protocol import COLUMNS  # noqa: PLC0415

    address = urlsplit(url)
    first = 0.0
    last = 0.0
    rows = 0
    with connect(f'ws://{address.netloc}{address.path}socket', proxy=None) as socket:
        try:
            while True:
                data = socket.recv()
                if not isinstance(data, bytes) or not data:
                    continue

                last = time.perf_counter()
                if first:
                    rows += len(data) // (8 * len(COLUMNS))
                else:
                    first = last
        except ConnectionClosed:
            return rows / (last - first)


def _work(task: dict[str, Any]) -> Any:  # noqa: ANN401 (JSON)
    """Drive, or count as a page: this file is the program of both."""
    if 'case' in task:
        return _drive(task)
    return _count(task['url'])


if __name__ == '__main__':
    print(json.dumps(_work(json.loads(sys.argv[1]))))
