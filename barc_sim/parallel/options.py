"""The options of commands that share their work: `--jobs` and `--scheduler`."""

from __future__ import annotations

from contextlib import contextmanager
from typing import TYPE_CHECKING

from barc_sim.cli.parser import show, whole
from barc_sim.cli.process import StopSignals

if TYPE_CHECKING:
    from argparse import Namespace
    from collections.abc import Callable, Iterator
    from concurrent.futures import Executor
    from contextlib import AbstractContextManager

    from barc_sim.cli.parser import Parser


def add_executor_options(parser: Parser, what: str, default: str = 'one for each core') -> None:
    """Add `--jobs` and `--scheduler`; `what` is done at once, in the plural."""
    group = parser.add_mutually_exclusive_group()
    group.add_argument('--jobs', type=whole(1), metavar='N', help=f'{what} at once ({default})')
    group.add_argument(
        '--scheduler',
        metavar='ADDRESS',
        help='let the workers of the Dask cluster with this scheduler do the work, such as '
        'tcp://10.0.0.1:8786',
    )


def executor_of(
    options: Namespace, check: Callable[[], str] | None = None
) -> AbstractContextManager[Executor]:
    """Return the executor that `--jobs` or `--scheduler` ask for, for a `with` block.

    `check` returns why a worker of a cluster cannot do the work; empty if it can.
    """
    if options.scheduler is not None:
        from barc_sim.parallel.cluster import cluster  # noqa: PLC0415 (slow: not for --help)

        return cluster(options.scheduler, check)
    from barc_sim.parallel.processes import processes  # noqa: PLC0415 (slow: not for --help)

    return processes(options.jobs)


@contextmanager
def interruptible_executor_of(options: Namespace) -> Iterator[Executor | None]:
    """Give the executor that `--jobs` or `--scheduler` ask for; None if there is neither option.

    Within the block, a signal that ends the process makes the results of calls raise
    KeyboardInterrupt. The executor has closed when that leaves this block.
    """
    if options.jobs is None and options.scheduler is None:
        yield None
        return

    from barc_sim.parallel.interruptible import InterruptibleExecutor  # noqa: PLC0415 (slow)

    try:
        with executor_of(options) as executor, StopSignals() as stop:
            shared = InterruptibleExecutor(executor)
            stop.then(shared.interrupt)
            yield shared
    except KeyboardInterrupt:
        show(f'barc {options.argv[0]}: interrupted', error=True)
        raise
