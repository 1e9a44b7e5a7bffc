"""The parameters that the nodes declare, read from the nodes themselves."""

from __future__ import annotations

import os
import random
from contextlib import contextmanager
from functools import cache
from importlib import import_module
from pathlib import Path
from tempfile import TemporaryDirectory
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any, NamedTuple

from rclpy.context import Context
from rclpy.parameter import Parameter

from barc_sim.interfaces.nodes import ALONE, CONTROLLER, SIMULATOR

if TYPE_CHECKING:
    from collections.abc import Iterator

    from rclpy.node import Node


#: Of every ROS 2 node.
_COMMON = {'use_sim_time', 'start_type_description_service'}
#: On a track, a node has more parameters.
_ON_TRACK = {SIMULATOR, CONTROLLER}


class Row(NamedTuple):
    """A parameter of a node, in words."""

    name: str
    default: str
    meaning: str
    range: str  #: and whether it is fixed for a run


@cache
def parameters() -> dict[str, list[Row]]:
    """Return the parameters of each node that has some of its own, sorted."""
    rows_by_node = {}
    with TemporaryDirectory() as folder, _hidden_context(folder) as context:
        for name in sorted(ALONE):
            rows = _rows(name, Path(folder), context, [])
            if name in _ON_TRACK:
                # The defaults are those without a track.
                rows = _rows(name, Path(folder), context, [Parameter('track', value='L')]) | rows
            if rows:
                rows_by_node[name] = [rows[parameter] for parameter in sorted(rows)]
    return rows_by_node


@contextmanager
def _hidden_context(log_folder: str) -> Iterator[Context]:
    """Yield a context whose nodes nobody else discovers."""
    before = os.environ.get('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'OFF'
    os.environ.setdefault('ROS_LOG_DIR', log_folder)
    context = Context()
    domain = random.randrange(1, 102)  # noqa: S311 (no secret)
    context.init(['--ros-args', '--log-level', 'error'], domain_id=domain)

    try:
        yield context
    finally:
        context.shutdown()
        os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = before


def _rows(name: str, folder: Path, context: Context, overrides: list[Parameter]) -> dict[str, Row]:
    """Return a row for each parameter of a node."""
    node = _make(name, folder, context, overrides)
    names = node._parameters.keys() - _COMMON  # noqa: SLF001 (rclpy has no other way)
    rows = {parameter: _row(node, parameter) for parameter in names}
    node.destroy_node()
    return rows


def _make(name: str, folder: Path, context: Context, overrides: list[Parameter]) -> Node:
    description = ALONE[name]
    node_class = getattr(import_module(description.module), description.class_name)

    arguments: dict[str, Any] = {}
    if name == 'keyboard':
        arguments['terminal'] = SimpleNamespace(listen=lambda _: None, close=lambda: None)
    elif name == 'bag_recorder':
        arguments['path'] = folder / 'bag'
    node: Node = node_class(**arguments, context=context, parameter_overrides=overrides)
    return node


def _row(node: Node, name: str) -> Row:
    descriptor = node.describe_parameter(name)
    default: Any = node.get_parameter(name).value
    if isinstance(default, bool):
        default = str(default).lower()

    ranges = [*descriptor.floating_point_range, *descriptor.integer_range]
    limits = 'fixed for a run' if descriptor.read_only else 'can be set while it runs'
    if ranges:
        limits = f'{ranges[0].from_value:g} to {ranges[0].to_value:g}; {limits}'
    return Row(name, str(default), descriptor.description, limits)
