"""The parameters of a run's nodes over time, from its metadata and `/parameter_events`."""

from __future__ import annotations

from array import array
from contextlib import suppress
from typing import TYPE_CHECKING, Any

import numpy as np

from barc_sim.bags import bounds
from barc_sim.cli.yaml_files import from_yaml

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

    from barc_sim.simulation.log import Floats

EVENT_TYPE = 'rcl_interfaces/msg/ParameterEvent'
_ROS_PARAMETERS = 'ros__parameters'
#: The field with the value of a number, by `rcl_interfaces/msg/ParameterType`.
_NUMBERS = {2: 'integer_value', 3: 'double_value'}


class ParameterHistory:
    """The values of parameters that are numbers, by node, each since a time of publication [ns]."""

    def __init__(self, description: str = '') -> None:
        """Begin with the values at the start: a run's metadata, as `ros2 param load` reads them.

        A description that cannot be read is left out, as it may be anyone's.
        """
        #: Times [ns] and values, by the full name of the node and by parameter.
        self._changes: dict[str, dict[str, tuple[array[int], array[float]]]] = {}
        self._count = 0
        for node, name, value in _numbers(description):
            self._add(node, name, 0, value)

    def add(self, event: Any, published: int) -> None:  # noqa: ANN401 (a ParameterEvent)
        """Take the changes of a node's parameters; ValueError: there are too many parameters."""
        for parameter in (*event.new_parameters, *event.changed_parameters):
            if field := _NUMBERS.get(parameter.value.type):
                value = float(getattr(parameter.value, field))
                self._add(event.node, parameter.name, published, value)

    def _add(self, node: str, name: str, since: int, value: float) -> None:
        of_node = self._changes.setdefault(node, {})
        if name not in of_node:
            self._count += 1
            if self._count > bounds.MAX_PARAMETERS or len(name) > bounds.MAX_NAME:
                raise ValueError('parameters')
            of_node[name] = array('Q'), array('d')
        times, values = of_node[name]
        times.append(since)
        values.append(value)

    def columns(self, node: str, times: NDArray[np.uint64]) -> dict[str, Floats]:
        """Return each parameter of a node at `times` [ns]; NaN before its first known value."""
        columns = {}
        for name, (since, values) in self._changes.get(node, {}).items():
            order = np.argsort(np.array(since, np.uint64), kind='stable')
            begins = np.array(since, np.uint64)[order]
            at = np.searchsorted(begins, times, side='right')
            columns[name] = np.append(np.nan, np.array(values)[order])[at]
        return columns


def described(text: str) -> dict[str, dict[str, Any]]:
    """Return the parameters in a run's metadata: values by node and name.

    What cannot be read is left out, as it may be anyone's.
    """
    try:
        nodes = from_yaml(text)
    except ValueError:
        return {}
    if not isinstance(nodes, dict):
        return {}
    parameters = {}
    for node, entry in nodes.items():
        values = entry.get(_ROS_PARAMETERS) if isinstance(entry, dict) else None
        if isinstance(values, dict):
            parameters[str(node)] = {str(name): value for name, value in values.items()}
    return parameters


def _numbers(text: str) -> Iterator[tuple[str, str, float]]:
    """Yield node, name and value of each number in a run's metadata."""
    for node, values in described(text).items():
        for name, value in values.items():
            if isinstance(value, (int, float)) and not isinstance(value, bool):
                with suppress(OverflowError):  # an integer beyond all floats
                    yield node, name, float(value)
