"""Work shared among processes: a sweep and a class, by --jobs and by the workers of a Dask cluster.

One worker and several, in turns. Shown are runs or submissions per second, the time, and the
processor time of all processes.
"""

from __future__ import annotations

import contextlib
import io
import resource
import tempfile
import time
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from _compare import Figures, Results, add_case, add_number, measure_in_turns, table
from grade import write_class

from barc_sim import sweep
from barc_sim.__main__ import main as barc
from barc_sim.cli.packages import extra
from barc_sim.errors import UserError
from barc_sim.parallel.cluster import cluster
from barc_sim.parallel.processes import processes

if TYPE_CHECKING:
    import argparse
    from collections.abc import Callable, Iterator
    from concurrent.futures import Executor

_CASES = ('sweep', 'class')
_WARM_UP = 100  # runs, with which each worker compiles the loop
QUICK = ('--repeat', '1', '--runs', '2000', '--submissions', '2', '--workers', '2')


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    add_number(parser, '--repeat', 5, 'repetitions')
    add_number(parser, '--runs', 1_000_000, 'runs of the sweep')
    add_number(parser, '--submissions', 60, 'submissions of the class')
    add_number(parser, '--workers', 2, 'workers, beside one')
    add_case(parser, _CASES)


def measure(options: argparse.Namespace) -> Results:
    """Return the figures of each number of workers, by --jobs and by Dask."""
    numbers = sorted({1, options.workers})
    subjects = [f'{kind} {number}' for kind in ('jobs', 'dask') for number in numbers]
    cases = options.case or _CASES

    def measure_once(case: str, subject: str) -> Figures:
        kind, _, number = subject.partition(' ')
        work = _class_work(options.submissions) if case == 'class' else _sweep_work(options.runs)
        with work as run:
            return run(kind, int(number))

    return measure_in_turns(dict.fromkeys(cases, subjects), options.repeat, measure_once)


@contextlib.contextmanager
def _sweep_work(count: int) -> Iterator[Callable[[str, int], Figures]]:
    """Provide a function that scores so many gains."""
    random = np.random.default_rng(0)
    kp = random.uniform(1.0, 60.0, count)
    ki = random.uniform(0.0, 40.0, count)

    def run(kind: str, workers: int) -> Figures:
        with _executor(kind, workers) as executor:
            sweep(kp=kp[: _WARM_UP * workers], ki=20.0, executor=executor)
            return _timed(lambda: sweep(kp=kp, ki=ki, executor=executor), count)

    yield run


@contextlib.contextmanager
def _class_work(count: int) -> Iterator[Callable[[str, int], Figures]]:
    """Provide a function that grades a class of so many submissions."""
    with tempfile.TemporaryDirectory(prefix='barc_sim_') as folder:
        submissions = Path(folder) / 'class'
        write_class(submissions, count)
        words = ['grade', str(submissions), '--out', str(Path(folder) / 'grades')]

        def grade(*options: str) -> None:
            with contextlib.redirect_stdout(io.StringIO()):
                code = barc([*words, *options])
            if code:
                raise UserError(f'grade ended with {code}')

        def run(kind: str, workers: int) -> Figures:
            if kind == 'jobs':
                return _timed(lambda: grade('--jobs', f'{workers}'), count)
            with _dask(workers) as address:
                return _timed(lambda: grade('--scheduler', address), count)

        yield run


@contextlib.contextmanager
def _executor(kind: str, workers: int) -> Iterator[Executor]:
    """Provide processes of this machine, or the workers of a cluster on it."""
    if kind == 'jobs':
        with processes(workers) as executor:
            yield executor
        return
    with _dask(workers) as address, cluster(address) as executor:
        yield executor


@contextlib.contextmanager
def _dask(workers: int) -> Iterator[str]:
    """Start a scheduler, and workers of one thread; provide its address."""
    distributed = extra('distributed', 'bench cluster', 'cluster')
    with distributed.LocalCluster(
        n_workers=workers, threads_per_worker=1, dashboard_address=None
    ) as local:
        yield local.scheduler_address


def _timed(work: Callable[[], object], count: int) -> Figures:
    """Return the figures of a work of so many pieces."""
    processor_before = _processor_time()
    began = time.perf_counter()
    work()
    seconds = time.perf_counter() - began
    processor = _processor_time() - processor_before
    return {'per second': count / seconds, 's': seconds, 'processor s': processor}


def _processor_time() -> float:
    """Return the processor time [s] of this process and of all that it has started."""
    psutil = extra('psutil', 'bench cluster', 'cluster')
    usages = (resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    total = sum(usage.ru_utime + usage.ru_stime for usage in usages)
    for child in psutil.Process().children(recursive=True):
        with contextlib.suppress(psutil.NoSuchProcess):
            total += sum(child.cpu_times()[:4])  # its own, and of those that it has waited for
    return total


def report(results: Results) -> str:
    """Return a table."""
    return table(results, ratio=False)
