"""Packages that a user can install in addition."""

from __future__ import annotations

from importlib import import_module
from typing import Any

from barc_sim.errors import UserError


def extra(module: str, user: str, name: str) -> Any:  # noqa: ANN401 (a module)
    """Import and return an optional package's module; UserError: it is not installed.

    `user` is what needs it, and `name` the extra of barc_sim that installs it.
    """
    try:
        return import_module(module)
    except ImportError:
        package = module.partition('.')[0]
        raise UserError(
            f"{user} needs {package}, which is not installed: pip install 'barc_sim[{name}]'"
        ) from None
