"""A live page's connection, without a browser."""

from __future__ import annotations

from typing import TYPE_CHECKING

from websockets.sync.client import connect

from barc_sim.page.protocol import COLUMNS

if TYPE_CHECKING:
    from websockets.sync.client import ClientConnection


def connect_page(url: str) -> ClientConnection:
    """Connect to the page at `url` as a browser does."""
    address = url.replace('http://', 'ws://') + 'socket'
    return connect(address, origin='/'.join(url.split('/')[:3]))  # type: ignore[arg-type]


def rows(received: str | bytes) -> list[dict[str, float]]:
    """Return the states of a binary message by column; none of another message."""
    if isinstance(received, str):
        return []
    values = memoryview(received).cast('d')
    width = len(COLUMNS)
    return [
        dict(zip(COLUMNS, values[k : k + width], strict=True)) for k in range(0, len(values), width)
    ]
