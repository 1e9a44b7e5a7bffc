"""Whether this rclpy and this machine have what the executor needs."""

from __future__ import annotations

import ctypes
import os
import re
import select
from importlib.metadata import PackageNotFoundError, version
from pkgutil import resolve_name

from barc_sim.ros.executor.rcl import check_functions
from barc_sim.ros.executor.rclpy_private import PRIVATE_NAMES

#: The first version of rclpy that may mean something else by the private names: Jazzy's are 7.1.x.
END_OF_VERSIONS = (7, 2)


def unsupported() -> str | None:
    """Return why this rclpy or machine cannot have a QuickExecutor; None: it can."""
    try:
        installed = version('rclpy')
    except PackageNotFoundError:  # built by hand: its names decide
        installed = ''
    numbers = tuple(int(number) for number in re.findall(r'\d+', installed)[:3])
    if numbers >= END_OF_VERSIONS:
        return f'rclpy {installed} is newer than this executor'
    lacking = missing()
    return f'this rclpy or machine has no {", ".join(lacking)}' if lacking else None


def missing() -> list[str]:
    """Return the names of what this rclpy, rcl or machine lacks."""
    lacking = []
    for path, names in PRIVATE_NAMES.items():
        owner = path.rpartition(':')[2]
        lacking += [f'{owner}.{name}' for name in names if _lacks(path, name)]
    if lacking:
        return lacking

    try:
        check_functions()
        _open_descriptors()
    except (AttributeError, OSError) as error:
        return [f'eventfd, timerfd, epoll or listeners ({error})']
    return []


def _open_descriptors() -> None:
    """Open one descriptor of each kind, and close it; OSError: a sandbox refuses it."""
    os.close(os.eventfd(0))
    os.close(ctypes.CDLL(None).timerfd_create(1, 0))
    select.epoll().close()


def _lacks(path: str, name: str) -> bool:
    """Return whether a module or class neither has a name nor uses it in a method."""
    try:
        owner = resolve_name(path)
    except (ImportError, AttributeError):
        return True
    if hasattr(owner, name):
        return False
    methods = [getattr(each, 'fset', each) for each in vars(owner).values()]
    return not any(
        name in method.__code__.co_names for method in methods if hasattr(method, '__code__')
    )
