"""Nodes under test, and a peer that talks with them."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any

from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter

if TYPE_CHECKING:
    from collections.abc import Callable

    from rclpy.context import Context


def overrides(**values: float | str | bool) -> list[Parameter]:
    """Return parameters of these values."""
    return [Parameter(name, value=value) for name, value in values.items()]


class NodeBench:
    """A node and its peer, which one executor spins."""

    def __init__(
        self, context: Context, spin_until: Callable[..., None], node: Node, namespace: str = ''
    ) -> None:
        self.node = node
        self.peer = Node('peer', context=context, namespace=namespace)
        self.executor = SingleThreadedExecutor(context=context)
        self.executor.add_node(node)
        self.executor.add_node(self.peer)
        self.until = partial(spin_until, self.executor)

    def call(self, kind: Any, service: str, **request: Any) -> Any:  # noqa: ANN401 (as it has them)
        """Return the response of a service to the peer."""
        client = self.peer.create_client(kind, service)
        self.until(client.service_is_ready)
        future = client.call_async(kind.Request(**request))
        self.until(future.done)
        self.peer.destroy_client(client)
        return future.result()

    def close(self) -> None:
        """End both nodes."""
        self.executor.shutdown()
        self.node.destroy_node()
        self.peer.destroy_node()
