"""The live page after the end of its run: downloads, the run before, and another run."""

from __future__ import annotations

import os
import sys
import time
import zipfile
from functools import cache
from io import BytesIO
from typing import TYPE_CHECKING
from urllib.parse import urlsplit

import numpy as np

from barc_sim.cli.parser import ROS_ARGS
from barc_sim.cli.process import NO_BROWSER
from barc_sim.control.lane import LANE
from barc_sim.errors import UserError
from barc_sim.page.protocol import CAR, OTHERS, SIMULATOR, File, Press, encode
from barc_sim.page.server import NEXT_RUN, Host

if TYPE_CHECKING:
    from argparse import Namespace
    from collections.abc import Iterator, Mapping
    from pathlib import Path

    from barc_sim.cli.process import StopSignals
    from barc_sim.page.protocol import Request
    from barc_sim.page.run_page import RunPage
    from barc_sim.page.server import Page
    from barc_sim.simulation.log import Log

_GONE_AFTER = 3.0  #: [s] without a page: a page that is loaded again is away for less
_POLL_PERIOD = 0.1  #: [s]
_LARGEST_BAG = 500 * 2**20  #: [B] to download
_REPORT, _BAG = 'report.html', 'bag.zip'
_OPTIONS = {'speed_reference': '--speed', 'acceleration_limit': '--acceleration-limit'}


def serve_ended_run(page: RunPage, options: Namespace, bag: Path | None, stop: StopSignals) -> None:
    """Serve the page of an ended run until it is closed, `stop` is requested, or it drives again.

    A run that nobody watches is not served. To drive again replaces this process.
    """
    if not page.is_watched:
        page.close()
        return
    ended = EndedRun(page, options.argv, bag)
    page.hand_over(ended, ended.offer())
    if not options.quiet:
        print('page    stays until it is closed, or Ctrl-C', flush=True)  # noqa: T201
    seen = time.monotonic()
    while not (stop.requested.wait(_POLL_PERIOD) or ended.next_command):
        if page.is_watched:
            seen = time.monotonic()
        elif time.monotonic() > seen + _GONE_AFTER:
            break
    page.close()
    if ended.next_command and not stop.requested.is_set():
        os.environ[NO_BROWSER] = '1'  # the page is open
        os.execv(sys.executable, [sys.executable, '-m', 'barc_sim', *ended.next_command])  # noqa: S606


class EndedRun(Host):
    """Serves the page of an ended run, with what can be done after it."""

    def __init__(self, page: RunPage, argv: list[str], bag: Path | None) -> None:
        """Serve the `page` of the run of the command line `argv`."""
        self.next_command: list[str] | None = None  #: of the next run, once it is asked for
        self._page, self._argv, self._bag = page, argv, bag
        self._before = _bag_before(bag) if bag else None
        self._files = [_REPORT, _BAG] if bag else []
        if bag and sum(path.stat().st_size for path in bag.iterdir()) > _LARGEST_BAG:
            self._files.remove(_BAG)

    def offer(self) -> str:
        """Return the message that shows a page what can be done."""
        before = self._before.name if self._before else None
        return encode('kept', files=self._files, before=before)

    def greet(self) -> Iterator[str | bytes]:
        """Yield the messages for a new page."""
        yield from self._page.greet()
        yield self.offer()

    def receive(self, page: Page, request: Request) -> None:
        """Show the run before, drive again, or take a slider's value for the next run."""
        match request:
            case Press('compare'):
                for message in self.compare():
                    page.send(message)
            case Press('again'):
                url = urlsplit(self._page.url)
                self.next_command = next_command(self._argv, self._page.values, url.port or 0)
                os.environ[f'{NEXT_RUN}{url.port}'] = url.path.strip('/')
                self._page.send(encode('again', address=self._page.url))
            case _:
                self._page.receive(page, request)

    def file(self, name: str) -> File | None:
        """Return the report or the bag."""
        if not self._bag or name not in self._files:
            return None
        if name == _REPORT:
            from barc_sim.lab.report import page, read  # noqa: PLC0415 (slow, and only on demand)

            return File('text/html', f'{self._bag.name}.html', page(read(self._bag)).encode())
        return File('application/zip', f'{self._bag.name}.zip', _zipped(self._bag))

    def compare(self) -> Iterator[str | bytes]:
        """Yield the messages that show the run before."""
        if self._before and (log := _read(self._before)):
            from barc_sim.page.run_page import other_run  # noqa: PLC0415

            yield from other_run(log, self._before.name)


def next_command(argv: list[str], values: Mapping[str, float], port: int) -> list[str]:
    """Return the command line `argv` with these values of the sliders, and the page at `port`."""
    end = argv.index(ROS_ARGS) if ROS_ARGS in argv else len(argv)
    words, ros_args = [*argv[:end]], [*argv[end:]]
    for name, value in values.items():
        if name in CAR:
            ros_args += ['-p', f'{SIMULATOR}:{name}:={value!r}']
        elif name in OTHERS:
            words += [_OPTIONS[name], f'{value!r}']
        elif name.startswith(LANE):
            words += ['--lane-gain', f'{name.removeprefix(LANE)}={value!r}']
        else:
            words += ['--gain', f'{name}={value!r}']
    words += ['--view', 'web', '--view-port', str(port)]
    if ros_args and ros_args[0] != ROS_ARGS:
        ros_args.insert(0, ROS_ARGS)
    return [*words, *ros_args]


def _bag_before(bag: Path) -> Path | None:
    """Return the newest bag beside `bag` that is older."""
    others = (path for path in bag.parent.iterdir() if path.is_dir() and path.name < bag.name)
    return max(others, key=lambda path: path.name, default=None)


@cache
def _read(bag: Path) -> Log | None:
    """Return the run in a bag; None where it cannot be read, or held no speed."""
    from barc_sim.bags import reader  # noqa: PLC0415 (only on demand)

    try:
        log = reader.read(bag)
    except UserError:
        return None
    return None if np.isnan(log.reference).all() else log


def _zipped(folder: Path) -> bytes:
    data = BytesIO()
    with zipfile.ZipFile(data, 'w', strict_timestamps=False) as archive:
        for path in sorted(folder.iterdir()):
            archive.write(path, f'{folder.name}/{path.name}')
    return data.getvalue()
