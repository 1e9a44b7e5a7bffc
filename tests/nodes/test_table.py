"""The table of nodes has the names, the topics and the services that the nodes have."""

from __future__ import annotations

from importlib import import_module
from importlib.util import find_spec
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import pytest
from node_bench import overrides

from barc_sim.interfaces import topics
from barc_sim.interfaces.nodes import ALONE, CONTROLLER, NODES, SIMULATOR, subscriptions_of
from barc_sim.interfaces.services import SERVICE_TYPES
from barc_sim.interfaces.topics import EVERYONES, MESSAGE_TYPES

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from rclpy.context import Context
    from rclpy.node import Node

#: Parameters with which a node has every topic of its own at least once.
CONFIGURATIONS: dict[str, list[dict[str, Any]]] = {
    SIMULATOR: [{'clock': True, 'track': 'L'}],
    CONTROLLER: [
        {},
        {'controller_type': 'lqr'},
        {'track': 'L'},
        *([{'track': 'L', 'lane_type': 'mpc'}] if find_spec('daqp') else []),
    ],
    'mirror': [{'track': 'L'}],
}
#: What a node lacks where an optional package is not installed.
OPTIONAL = {topics.PREDICTION} if not find_spec('daqp') else set()
OPTIONAL |= {topics.TF} if not find_spec('tf2_msgs') else set()


def arguments(name: str, folder: Path) -> dict[str, Any]:
    """Return the arguments with which a test makes a node."""
    if name == 'keyboard':
        return {'terminal': SimpleNamespace(listen=lambda _: None, close=lambda: None)}
    return {'path': folder / 'bag'} if name == 'bag_recorder' else {}


def nodes_of(name: str, folder: Path, context: Context) -> Iterator[Node]:
    """Yield a node in each of its configurations."""
    description = NODES[name]
    node_class = getattr(import_module(description.module), description.class_name)
    for parameters in CONFIGURATIONS.get(name, [{}]):
        node = node_class(
            **arguments(name, folder),
            context=context,
            parameter_overrides=overrides(**parameters),
        )
        yield node
        node.destroy_node()


def short(name: str) -> str:
    """Return a topic or a service as the table names it."""
    return name if name in MESSAGE_TYPES else name.removeprefix('/')


def type_name(kind: Any) -> str:  # noqa: ANN401 (of a message or a service)
    package, part, _ = kind.__module__.split('.', 2)
    return f'{package}/{part}/{kind.__name__}'


@pytest.mark.parametrize('name', ALONE)
def test_a_node_has_the_name_the_topics_and_the_services_of_the_table(
    name: str, ros: Context, tmp_path: Path
) -> None:
    published, subscribed, served = {}, {}, {}
    for node in nodes_of(name, tmp_path, ros):
        assert node.get_name() == name
        published |= {short(each.topic_name): type_name(each.msg_type) for each in node.publishers}
        subscribed |= {
            short(each.topic_name): type_name(each.msg_type) for each in node.subscriptions
        }
        served |= {short(each.srv_name): type_name(each.srv_type) for each in node.services}

    of_every_node = {*map(short, EVERYONES)}
    description = NODES[name]
    assert published.keys() - of_every_node == {*description.publishes} - OPTIONAL
    assert subscribed.keys() - of_every_node == {*description.subscribes}

    own_services = {service for service in served if service in SERVICE_TYPES}
    assert own_services == {*description.serves}
    for topic, kind in (published | subscribed).items():
        assert MESSAGE_TYPES.get(topic, kind) == kind
    for service in own_services:
        assert served[service] == SERVICE_TYPES[service]


def test_the_subscriptions_of_a_class_are_those_of_its_row() -> None:
    for description in NODES.values():
        node_class = getattr(import_module(description.module), description.class_name)
        assert subscriptions_of(node_class) == description.subscribes
    assert subscriptions_of(SimpleNamespace) == ()


def test_every_topic_and_service_belongs_to_a_node() -> None:
    described = NODES.values()
    used_topics = {topic for node in described for topic in (*node.publishes, *node.subscribes)}
    assert used_topics == MESSAGE_TYPES.keys()
    served = [service for node in described for service in node.serves]
    assert sorted(served) == sorted(SERVICE_TYPES)
    assert {service for node in described for service in node.calls} <= {*served}
