"""What runs on the workers of a Dask cluster before they get work; imported where Dask is."""

from __future__ import annotations

from typing import TYPE_CHECKING

from distributed import Status, WorkerPlugin

import barc_sim

if TYPE_CHECKING:
    from collections.abc import Callable

    from distributed import Worker

#: The resource of the workers that can do the work: Dask gives calls that need it to no other.
ABLE = 'barc_sim'


class CheckWorker(WorkerPlugin):
    """Checks each worker of a cluster, also those that join later, and marks those that are able.

    Parameters
    ----------
    check
        Called on the worker: returns why it cannot do the work; empty if it can.
    """

    name = 'barc_sim'

    def __init__(self, check: Callable[[], str] | None) -> None:
        self._check = check
        self._version = barc_sim.__version__  # the client's

    async def setup(self, worker: Worker) -> None:
        """Mark the worker if it can do the work; Dask calls this."""
        if reason_of(self._check, self._version):
            return

        await worker.set_resources(**{ABLE: worker.state.nthreads})
        # The scheduler looks again at calls for which there was no worker when one begins to run,
        # but not when one gets a resource.
        worker.status = Status.paused
        worker.status = Status.running


def reason_of(check: Callable[[], str] | None, version: str) -> str:
    """Return why this worker cannot do the work of a client of a version; empty if it can."""
    if barc_sim.__version__ != version:
        return f'it has barc_sim {barc_sim.__version__}, and this is {version}: install the same'
    return check() if check else ''
