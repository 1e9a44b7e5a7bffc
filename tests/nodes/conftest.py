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
    made: list[Any] = []

    def make(kind: Callable[..., Any], *arguments: Any, **options: Any) -> Any:  # noqa: ANN401
        made.append(kind(ros, spin_until, *arguments, **options))
        return made[-1]

    yield make
    for bench in made:
        bench.close()
