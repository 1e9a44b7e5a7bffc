"""Packages that a user can install in addition."""

from __future__ import annotations

from importlib import import_module
from typing import Any

from barc_sim.errors import UserError


def extra(module: str, user: str, name: str) -> Any:  # noqa: ANN401 (a module)
    """Import and return an optional package's module.

    Parameters
    ----------
    module
        The module's full name.
    user
        What needs it, for the error.
    name
        The extra of barc_sim that installs it.

    Raises
    ------
    UserError
        It is not installed.
    """
    try:
        return import_module(module)
    except ImportError:
        package = module.partition('.')[0]
        raise UserError(
            f"{user} needs {package}, which is not installed: pip install 'barc_sim[{name}]'"
        ) from None
