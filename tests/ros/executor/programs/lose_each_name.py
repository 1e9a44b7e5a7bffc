"""Lose each private name that the executor needs, in a process of its own; print its warning."""

from __future__ import annotations

import os
import sys
import warnings
from pkgutil import resolve_name
from typing import Any

from barc_sim.ros.executor.rclpy_private import PRIVATE_NAMES

for module in [name for name in sys.modules if name.startswith('barc_sim.ros')]:
    del sys.modules[module]


def lose(owner: Any, name: str) -> None:
    """Remove a name from a module or class, and from the methods that use it."""
    if name in vars(owner):
        vars(owner).get('_member_map_', {}).pop(name, None)  # of an Enum
        if hasattr(owner, '__members__'):
            type.__delattr__(owner, name)
        else:
            delattr(owner, name)
    for member in list(vars(owner).values()):
        method = getattr(member, 'fset', member)
        if hasattr(method, '__code__') and name in method.__code__.co_names:
            names = tuple('gone' if n == name else n for n in method.__code__.co_names)
            method.__code__ = method.__code__.replace(co_names=names)


def owner_of(path: str, name: str) -> Any:
    """Return the module, or the first class of its bases, that has a name."""
    owner = resolve_name(path)
    for base in getattr(owner, '__mro__', ()):
        if name in vars(base):
            return base
    return owner


def check(path: str, name: str) -> None:
    """Lose a name, import the executor, and print whether it has named it."""
    lose(owner_of(path, name), name)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter('always')
        import barc_sim.ros.executor  # noqa: F401
    warned = [str(each.message) for each in caught if 'QuickExecutor' in str(each.message)]
    print(len(warned) == 1 and name in warned[0], path, name, warned, flush=True)


for path, names in PRIVATE_NAMES.items():
    for name in names:
        if os.fork():
            os.wait()
        else:
            check(path, name)
            os._exit(0)
