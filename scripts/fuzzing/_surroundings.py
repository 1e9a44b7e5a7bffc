"""Links, pipes, sockets, devices and folders beside a bag's file, or in its place."""

from __future__ import annotations

import os
import socket
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path
    from random import Random

_OUTSIDE = b'not of the bag'
_NEIGHBOURS = (
    *('run_0.mcap', 'run_1.mcap', 'metadata.yaml', '.metadata.yaml', '.run_0.mcap.part'),
    *('speed.png', '.speed.png', 'report.html', 'graph.svg', 'any'),
)


def surround(path: Path, chance: Random) -> None:
    """Put what is no plain file beside the bag's file, or in its place."""
    outside = _outside(path)
    outside.mkdir()
    (outside / 'file').write_bytes(_OUTSIDE)

    makers: list[Callable[[Path], object]] = [
        *(_link_to(outside / name) for name in ('', 'file', 'none')),
        *(_link_to(name) for name in ('run_0.mcap', '/dev/zero', 'loop')),
        _hard_link_to(outside / 'file'),
        *(os.mkfifo, _make_folder, _bind),
    ]
    for name in chance.sample(_NEIGHBOURS, chance.choice((1, 1, 2, 5))):
        place = path.with_name(name)
        place.unlink(missing_ok=True)
        make = chance.choice(makers)
        make(place)


def check_outside(path: Path) -> None:
    """Raise an AssertionError if something outside of the bag has changed."""
    outside = _outside(path)
    names = [file.name for file in outside.iterdir()]
    if names != ['file'] or (outside / 'file').read_bytes() != _OUTSIDE:
        raise AssertionError(f'outside of the bag: {names}')


def _outside(path: Path) -> Path:
    return path.parent.with_name(f'{path.parent.name} outside')


def _link_to(target: str | Path) -> Callable[[Path], None]:
    def make(path: Path) -> None:
        path.symlink_to(target)

    return make


def _hard_link_to(target: Path) -> Callable[[Path], None]:
    def make(path: Path) -> None:
        path.hardlink_to(target)

    return make


def _make_folder(path: Path) -> None:
    path.mkdir()


def _bind(path: Path) -> None:
    with socket.socket(socket.AF_UNIX) as server:
        server.bind(str(path))
