"""A Dask cluster, for `--scheduler`."""

from __future__ import annotations

import importlib
import logging
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from barc_sim.errors import UserError

if TYPE_CHECKING:
    from collections.abc import Iterator

_PATIENCE = 5  # s, until the cluster answers


@contextmanager
def client(address: str) -> Iterator[Any]:
    """Give a `distributed.Client` of the scheduler at `address`, which has workers."""
    try:
        distributed: Any = importlib.import_module('distributed')
    except ImportError:
        raise UserError(
            f'--scheduler {address!r} needs Dask, which is not installed: pip install distributed'
        ) from None
    # Errors are reported below, in one sentence.
    logging.getLogger('distributed').setLevel(logging.CRITICAL)
    try:
        # A client with an invalid address would hang when it is taken down.
        distributed.comm.resolve_address(address)
        connected = distributed.Client(address, timeout=_PATIENCE, set_as_default=False)
    except (OSError, TimeoutError, ValueError) as error:
        raise UserError(
            f'no Dask scheduler answers at {address!r}: expected an address such as '
            f'tcp://localhost:8786 ({error})'
        ) from None
    with connected:
        if not connected.ncores():
            raise UserError(
                f'the Dask scheduler at {address!r} has no workers: start some, with dask worker'
            )
        yield connected
