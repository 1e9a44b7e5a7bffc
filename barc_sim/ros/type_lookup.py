"""Asks publishers for the definitions of types that are installed without theirs."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from type_description_interfaces.srv import GetTypeDescription

from barc_sim.bags.schemas import definition_of

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from rclpy.node import Node
    from rclpy.topic_endpoint_info import TopicEndpointInfo

#: [s] to wait for a node's answer.
_TIMEOUT = 5.0


def request_definition(
    node: Node,
    publishers: Sequence[TopicEndpointInfo],
    on_answer: Callable[[str | None], None],
) -> None:
    """Ask the node of a topic's first publisher for the definition of its type.

    Parameters
    ----------
    node
        The client, which must be spun.
    publishers
        Those of the topic.
    on_answer
        Called once, with the `ros2msg` schema, or None where there is none.
    """
    publisher = publishers[0]
    namespace = publisher.node_namespace.rstrip('/')
    client = node.create_client(
        GetTypeDescription, f'{namespace}/{publisher.node_name}/get_type_description'
    )
    request = GetTypeDescription.Request(
        type_name=publisher.topic_type,
        type_hash=str(publisher.topic_type_hash),
        include_type_sources=False,
    )
    response = client.call_async(request)

    def finish() -> None:
        timer.cancel()
        node.destroy_timer(timer)
        node.destroy_client(client)
        found = response.result() if response.done() else None
        on_answer(_definition(publisher.topic_type, found))

    timer = node.create_timer(_TIMEOUT, finish)
    response.add_done_callback(lambda _: finish() if not timer.is_canceled() else None)


def _definition(name: str, response: Any) -> str | None:  # noqa: ANN401 (a generated class)
    if not response or not response.successful:
        return None
    found = response.type_description
    descriptions = [found.type_description, *found.referenced_type_descriptions]
    try:
        return definition_of(name, [_as_json(description) for description in descriptions])
    except LookupError:
        return None


def _as_json(description: Any) -> dict[str, Any]:  # noqa: ANN401 (a generated class)
    return {
        'type_name': description.type_name,
        'fields': list(_fields(description.fields)),
    }


def _fields(fields: Sequence[Any]) -> Iterator[dict[str, Any]]:
    for field in fields:
        names = ('type_id', 'capacity', 'string_capacity', 'nested_type_name')
        yield {'name': field.name, 'type': {name: getattr(field.type, name) for name in names}}
