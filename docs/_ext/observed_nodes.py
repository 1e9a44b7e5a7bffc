"""What the nodes publish, subscribe to, serve and declare, read from the nodes themselves."""

from __future__ import annotations

import importlib
import inspect
import os
import random
import re
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from types import ModuleType, SimpleNamespace
from typing import Any

from rclpy.context import Context
from rclpy.node import Node
from rclpy.parameter import Parameter

from barc_sim.commands import NODES
from barc_sim.interfaces import services as service_names
from barc_sim.interfaces import topics as topic_names

#: Of every ROS 2 node.
_COMMON = {'/parameter_events', '/rosout', 'use_sim_time', 'start_type_description_service'}
#: So that all that a node can publish is seen.
_OVERRIDES = {
    'vehicle_simulator': [Parameter('clock', value=True), Parameter('track', value='L')],
    'controller': [Parameter('track', value='L')],
}


def _node_class(module: str) -> type[Node]:
    """Return the node that a module of `nodes` defines."""
    found = importlib.import_module(f'barc_sim.nodes.{module}')
    (node,) = (
        each
        for each in vars(found).values()
        if inspect.isclass(each) and issubclass(each, Node) and each.__module__ == found.__name__
    )
    return node


def _arguments(name: str, folder: str) -> dict[str, Any]:
    if name == 'keyboard':
        terminal = SimpleNamespace(listen=lambda _: None, close=lambda: None)
        return {'terminal': terminal}
    return {'path': Path(folder) / 'bag'} if name == 'bag_recorder' else {}


@cache
def _nodes() -> dict[str, dict[str, Any]]:
    """Make each node once, in a domain of this machine alone, and note what it has."""
    before = os.environ.get('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'OFF'
    context = Context()
    seen: dict[str, dict[str, Any]] = {}
    with TemporaryDirectory() as folder:
        os.environ.setdefault('ROS_LOG_DIR', folder)
        context.init(['--ros-args', '--log-level', 'error'], domain_id=random.randrange(1, 102))  # noqa: S311
        for name, (module, _) in NODES.items():
            for overrides in filter(None, (_OVERRIDES.get(name), [None])):
                node = _node_class(module)(
                    **_arguments(name, folder),
                    context=context,
                    parameter_overrides=[each for each in overrides if each],
                )
                noted = _noted(node)
                node.destroy_node()
                seen.setdefault(name, noted)['parameters'] |= noted['parameters']
        context.shutdown()
    os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = before
    return seen


def _type(kind: Any) -> str:
    return f'{kind.__module__.split(".")[0]}/{kind.__name__}'


def _relative(topic: str) -> str:
    """Return a topic as `interfaces/topics.py` has it."""
    known = {value for value in vars(topic_names).values() if isinstance(value, str)}
    return topic if topic in known else topic.removeprefix('/')


def _noted(node: Node) -> dict[str, Any]:
    return {
        'publishes': {_relative(each.topic_name): _type(each.msg_type) for each in node.publishers},
        'subscribes': {
            _relative(each.topic_name): _type(each.msg_type) for each in node.subscriptions
        },
        'serves': {
            _relative(each.srv_name): _type(each.srv_type)
            for each in node.services
            if not re.search('_parameter|_type_desc', each.srv_name)
        },
        'parameters': {name: _parameter(node, name) for name in node._parameters},  # noqa: SLF001
    }


def _parameter(node: Node, name: str) -> tuple[str, str, str, str, str]:
    told = node.describe_parameter(name)
    ranges = [*told.floating_point_range, *told.integer_range]
    between = f'{ranges[0].from_value:g} to {ranges[0].to_value:g}; ' if ranges else ''
    default: Any = node.get_parameter(name).value
    if isinstance(default, bool):
        default = str(default).lower()
    fixed = 'fixed for a run' if told.read_only else 'can be set while it runs'
    return name, str(default), between, fixed, told.description


def topics() -> dict[str, tuple[str, list[str], list[str]]]:
    """Return type, publishers and subscribers of each topic, by its name."""
    found: dict[str, tuple[str, list[str], list[str]]] = {}
    for node, noted in _nodes().items():
        for i, key in enumerate(('publishes', 'subscribes')):
            for topic, kind in noted[key].items():
                if topic not in _COMMON and f'/{topic}' not in _COMMON:
                    ends = found.setdefault(topic, (kind, [], []))[1 + i]
                    ends.append(node)
    return dict(sorted(found.items(), key=lambda item: item[0].lstrip('/')))


def services() -> dict[str, str]:
    """Return the type of each service, by its name."""
    return dict(sorted(pair for noted in _nodes().values() for pair in noted['serves'].items()))


def parameters() -> dict[str, list[tuple[str, str, str, str, str]]]:
    """Return name, default, range, whether it is fixed, and meaning of each node's parameters."""
    return {
        node: [row for name, row in sorted(noted['parameters'].items()) if name not in _COMMON]
        for node, noted in _nodes().items()
        if noted['parameters'].keys() - _COMMON
    }


def meanings() -> dict[str, str]:
    """Return the comment at each name, by the topic or service that it stands for."""
    return _meanings(topic_names) | _meanings(service_names)


def _meanings(module: ModuleType) -> dict[str, str]:
    text = Path(module.__file__ or '').read_text('utf-8')
    comments = re.findall(
        r"^(?:#: (.*)\n)?([A-Z_]+) = '[\w./]+'(?:  #: (.*))?$", text, re.MULTILINE
    )
    return {
        getattr(module, name): before or behind
        for before, name, behind in comments
        if before or behind
    }
