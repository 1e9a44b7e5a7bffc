"""Fixtures of the nodes' tests."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import pytest

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from rclpy.context import Context


@pytest.fixture
def benches(ros: Context, spin_until: Callable[..., None]) -> Iterator[Callable[..., Any]]:
    """Return a function that makes a bench of the class that it is given, gone after the test."""
    benches_of_test: list[Any] = []

    def make(kind: Callable[..., Any], *arguments: Any, **options: Any) -> Any:  # noqa: ANN401
        benches_of_test.append(kind(ros, spin_until, *arguments, **options))
        return benches_of_test[-1]

    yield make
    for bench in benches_of_test:
        bench.close()
