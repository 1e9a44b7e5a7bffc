"""A live page's connection, without a browser."""

from __future__ import annotations

import json
import time
from typing import TYPE_CHECKING, Any

from websockets.sync.client import connect

from barc_sim.page.protocol import COLUMNS

if TYPE_CHECKING:
    from collections.abc import Callable

    from websockets.sync.client import ClientConnection

PATIENCE = 100.0  #: [s]


def connect_page(url: str) -> ClientConnection:
    """Connect to the page at `url` as a browser does."""
    return connect(url.replace('http://', 'ws://') + 'socket')


def rows(received: str | bytes) -> list[dict[str, float]]:
    """Return the states of a binary message by column; none of another message."""
    if isinstance(received, str):
        return []
    values = memoryview(received).cast('d')
    width = len(COLUMNS)
    return [
        dict(zip(COLUMNS, values[k : k + width], strict=True)) for k in range(0, len(values), width)
    ]


def wait(connection: ClientConnection, kind: str | Callable[[dict[str, Any]], bool]) -> Any:  # noqa: ANN401
    """Return the next message of a type, or message or row of a state for which `what` is true."""
    until = time.monotonic() + PATIENCE
    while time.monotonic() < until:
        message = connection.recv(timeout=PATIENCE)
        candidates = [json.loads(message)] if isinstance(message, str) else [*rows(message)]
        for candidate in candidates:
            if candidate.get('type') == kind if isinstance(kind, str) else kind(candidate):
                return candidate
    raise AssertionError('it did not come')
