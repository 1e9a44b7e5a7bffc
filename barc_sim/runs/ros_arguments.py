"""Finds the parameters after `--ros-args` that set nothing."""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING

from barc_sim.cli.parser import warn

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rclpy.node import Node


def warn_of_unused(ros_args: Sequence[str], nodes: Sequence[Node]) -> None:
    """Warn of each parameter after `--ros-args` that no node has; ROS ignores it."""
    for option, text in pairwise(ros_args):
        is_file = option == '--params-file'
        for owner, name in _parameters(option, text):
            # A file can have the nodes of other systems.
            if _is_set(owner, name, nodes) or (is_file and not _is_named(owner, nodes)):
                continue

            source = text if is_file else '-p'
            prefix = f'{owner}:' if owner else ''
            warn(
                f'{source} {prefix}{name} sets nothing, as no node has this parameter; in a '
                'namespace, leave out the node after -p, and in a file name it in full'
            )


def _parameters(option: str, text: str) -> list[tuple[str, str]]:
    """Return node and name of the parameters that an option sets; the node is empty for all."""
    from barc_sim.ros.local.parameters import Arguments  # noqa: PLC0415 (of few runs)

    try:
        rules = Arguments(['--ros-args', option, text]).parameters
    except RuntimeError:  # the two words are no option with its value
        return []
    return [(rule.node.lstrip('/'), rule.name) for rule in rules]


def _is_set(owner: str, name: str, nodes: Sequence[Node]) -> bool:
    """Return whether ROS sets the parameter of a node: it looks for the node by its full name."""
    return any(owner in ('', _full_name(node)) and node.has_parameter(name) for node in nodes)


def _is_named(owner: str, nodes: Sequence[Node]) -> bool:
    """Return whether `owner` means a node of this run, perhaps without its namespace."""
    return any(owner in ('', _full_name(node), node.get_name()) for node in nodes)


def _full_name(node: Node) -> str:
    return str(node.get_fully_qualified_name()).lstrip('/')
