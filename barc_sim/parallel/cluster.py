"""The workers of a Dask cluster. Dask brings the scheduler, the workers, retries and security."""

from __future__ import annotations

import asyncio
import logging
import socket
from concurrent.futures import CancelledError
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING

from barc_sim import __version__
from barc_sim.cli.packages import extra
from barc_sim.cli.parser import show
from barc_sim.errors import UserError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from concurrent.futures import Executor
    from types import ModuleType

_TIMEOUT = 10.0  #: [s] to connect to a scheduler
_HOW_TO_START = 'start one with `dask scheduler`, and give the address that it prints'


@contextmanager
def cluster(address: str, check: Callable[[], str] | None = None) -> Iterator[Executor]:
    """Use the workers of a Dask cluster, also those that join it later.

    Parameters
    ----------
    address
        The scheduler's, such as tcp://10.0.0.1:8786.
    check
        Called on each worker: returns why it cannot do the work, in a sentence; empty if it
        can. By default all can.

    Raises
    ------
    UserError
        Dask is not installed, there is no scheduler at the address, no worker gets work, or
        the scheduler ends.
    """
    distributed = extra('distributed', '--scheduler', 'cluster')
    _check_scheduler(distributed, address)
    from barc_sim.parallel.workers import ABLE, CheckWorker, reason_of  # noqa: PLC0415 (needs Dask)

    # A lost scheduler is reported below, in a sentence; Dask logs tracebacks of it.
    logging.getLogger('distributed.client').setLevel(logging.CRITICAL)

    plugin = CheckWorker(check)
    with distributed.Client(address, timeout=f'{_TIMEOUT} s', set_as_default=False) as client:
        try:
            reasons = client.run(reason_of, check, __version__)
        except Exception as error:
            if 'ModuleNotFoundError' not in repr(error):  # Dask raises an exception with its text
                raise
            raise UserError(
                f'the workers at {address!r} lack barc_sim: install the same version there, '
                f'{__version__} ({error})'
            ) from None
        client.register_plugin(plugin)

        unable = {worker: reason for worker, reason in reasons.items() if reason}
        for worker, reason in sorted(unable.items()):
            show(f'the worker {worker} gets no work: {reason}', error=True)
        if reasons and len(unable) == len(reasons):
            raise UserError(f'no worker at {address!r} can do this work: start others')
        if not reasons:
            show(
                f'no worker has joined {address} yet: start one with `dask worker {address}`',
                error=True,
            )

        try:
            yield client.get_executor(pure=False, resources={ABLE: 1})
        except CancelledError:  # of all calls, when the client has lost the scheduler
            if client.status == 'running':
                raise
            raise UserError(
                f'the Dask scheduler at {address!r} has ended: start it and its workers, and '
                'repeat the command'
            ) from None
        finally:
            with suppress(OSError, RuntimeError):  # without a scheduler there is no plugin
                client.unregister_worker_plugin(plugin.name)


def _check_scheduler(distributed: ModuleType, address: str) -> None:
    """Raise UserError if no scheduler answers at an address."""
    from distributed.comm.addressing import get_address_host_port  # noqa: PLC0415 (optional)

    try:
        with socket.create_connection(get_address_host_port(address, strict=True), _TIMEOUT):
            pass
    except (OSError, ValueError) as error:
        reason = getattr(error, 'strerror', None) or error
        raise UserError(
            f'there is no Dask scheduler at {address!r} ({reason}): {_HOW_TO_START}'
        ) from None

    # A client of Dask waits without end for a program of another kind, such as the dashboard.
    try:
        kind = asyncio.run(_kind_of(distributed, address))
    except Exception:  # noqa: BLE001 (what another program sends can raise any)
        kind = 'program of another kind'
    if kind != 'Scheduler':
        raise UserError(f'there is a {kind} at {address!r}, and no Dask scheduler: {_HOW_TO_START}')


async def _kind_of(distributed: ModuleType, address: str) -> str:
    """Return what a process of Dask calls itself: Scheduler, Worker or Nanny."""
    arguments = distributed.Security().get_connection_args('client')
    async with distributed.rpc(address, timeout=_TIMEOUT, connection_args=arguments) as process:
        identity = await asyncio.wait_for(process.identity(), _TIMEOUT)
    return str(identity['type'])
