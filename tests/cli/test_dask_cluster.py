"""A Dask cluster that is not there, has no workers, or without Dask: a sentence each."""

from __future__ import annotations

import importlib
from typing import Any

import pytest

from barc_sim.cli.dask_cluster import client
from barc_sim.errors import UserError


def test_a_cluster_without_workers_is_refused() -> None:
    distributed: Any = pytest.importorskip('distributed')
    with (
        distributed.LocalCluster(
            n_workers=0, processes=False, protocol='tcp', dashboard_address=':0'
        ) as cluster,
        pytest.raises(UserError, match='has no workers'),
        client(cluster.scheduler_address),
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
        client(address),
    ):
        pass


def test_without_dask_the_error_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    def missing(name: str) -> None:
        raise ModuleNotFoundError(f'No module named {name!r}')

    monkeypatch.setattr(importlib, 'import_module', missing)
    with (
        pytest.raises(UserError, match='which is not installed: pip install distributed'),
        client('tcp://localhost:8786'),
    ):
        pass
