"""What a bag says of the run that it holds."""

from __future__ import annotations

import shlex
from platform import platform, python_version
from typing import TYPE_CHECKING, Any

import yaml

from barc_sim import __version__
from barc_sim.control.types import GAINS

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rclpy.node import Node


def describe(argv: list[str], nodes: Sequence[Node]) -> dict[str, str]:
    """Return what a run is: `parameters` in the form that `ros2 param load` takes."""
    values = [(node.get_fully_qualified_name(), _parameters(node)) for node in nodes]
    # By name, whatever the nodes are called: `-r __node:=car` calls all of them alike.
    own = {name: value for _, parameters in values for name, value in parameters.items()}
    return {
        'command': shlex.join(['python', '-m', 'barc_sim.run', *argv]),
        'barc_sim': __version__,
        'python': python_version(),
        'platform': platform(),
        'parameters': yaml.safe_dump(
            {name: {'ros__parameters': parameters} for name, parameters in values},
            sort_keys=False,
        ),
        **{name: str(own[name]) for name in (*GAINS, 'road') if name in own},
    }


def _parameters(node: Node) -> dict[str, Any]:
    names = node.list_parameters(prefixes=[], depth=0).names
    return {parameter.name: parameter.value for parameter in node.get_parameters(names)}
