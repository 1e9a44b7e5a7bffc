"""The workers of a Dask cluster; `test_goal` has those of this machine."""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from barc_sim.errors import UserError
from barc_sim.tuning import workers
from barc_sim.tuning.batch import Course
from barc_sim.tuning.goal import Cost, Goal

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

GOAL = Goal((Course(distance=30.0),), Cost.parse('rms'))
GAINS = np.random.default_rng(0).random((20, 3)) * [40.0, 300.0, 0.5]


def failing(_: NDArray[np.float64]) -> NDArray[np.float64]:
    raise ZeroDivisionError('of a worker')


def refusing(_: NDArray[np.float64]) -> NDArray[np.float64]:
    raise UserError('no road there')


@pytest.fixture(scope='module')
def scheduler() -> Iterator[str]:
    """Return the address of a cluster in threads of this process."""
    distributed: Any = pytest.importorskip('distributed')
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=False, protocol='tcp', dashboard_address=':0'
    ) as cluster:
        yield cluster.scheduler_address


def test_a_cluster_gives_what_one_process_gives(scheduler: str) -> None:
    with workers.cluster(GOAL, scheduler) as cost:
        for gains in (GAINS, GAINS[:1], np.tile(GAINS, (250, 1))):
            assert cost(gains).tolist() == GOAL(gains).tolist()


def test_a_users_error_on_a_worker_is_passed_on(scheduler: str) -> None:
    with workers.cluster(refusing, scheduler) as cost, pytest.raises(UserError) as error:
        cost(GAINS)
    assert str(error.value) == 'no road there'


def test_any_other_error_on_a_worker_names_the_cluster(scheduler: str) -> None:
    with workers.cluster(failing, scheduler) as cost, pytest.raises(UserError) as error:
        cost(GAINS)
    assert str(error.value).startswith(
        f'the Dask cluster at {scheduler!r} failed: ZeroDivisionError: of a worker; '
    )


def test_a_cluster_without_workers_is_refused() -> None:
    distributed: Any = pytest.importorskip('distributed')
    with (
        distributed.LocalCluster(
            n_workers=0, processes=False, protocol='tcp', dashboard_address=':0'
        ) as cluster,
        pytest.raises(UserError, match='has no workers'),
        workers.cluster(GOAL, cluster.scheduler_address),
    ):
        pass


@pytest.mark.parametrize('address', ['nowhere', 'foo://localhost:1', 'tcp://localhost:1'])
def test_a_scheduler_that_is_not_there_is_refused(
    address: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip('distributed')
    monkeypatch.setattr('barc_sim.cli.dask_cluster._PATIENCE', 0.5)
    with (
        pytest.raises(UserError, match=f'no Dask scheduler answers at {address!r}'),
        workers.cluster(GOAL, address),
    ):
        pass


def test_without_dask_the_error_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    def missing(name: str) -> None:
        raise ModuleNotFoundError(f'No module named {name!r}')

    monkeypatch.setattr(importlib, 'import_module', missing)
    with (
        pytest.raises(UserError, match='which is not installed: pip install distributed'),
        workers.cluster(GOAL, 'tcp://localhost:8786'),
    ):
        pass


@pytest.mark.parametrize(('loops', 'parts'), [(260, [260]), (5000, [2500, 2500])])
def test_loops_that_numpy_drives_at_once_are_divided_into_large_parts(
    scheduler: str, monkeypatch: pytest.MonkeyPatch, loops: int, parts: list[int]
) -> None:
    sizes: list[int] = []

    def count(_: Goal, gains: NDArray[np.float64]) -> NDArray[np.float64]:
        sizes.append(len(gains))
        return np.zeros(len(gains))

    monkeypatch.setattr(Goal, '__call__', count)
    with workers.cluster(GOAL, scheduler) as cost:
        assert len(cost(np.tile(GAINS[:1], (loops, 1)))) == loops
    assert sizes == parts
