"""What the nodes of a run without ROS share, and what each of them has as a node."""

from __future__ import annotations

import sys
import time
from collections import deque
from typing import TYPE_CHECKING, Any

import numpy as np

from barc_sim.bags.cdr import NANOSECONDS
from barc_sim.bags.messages import message_class
from barc_sim.errors import UserError
from barc_sim.runs.local.loop import Loop
from barc_sim.runs.local.parameters import EVERY_NODES, RosArguments, checked
from barc_sim.runs.local.topics import Publisher, Topics

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from barc_sim.vehicle.parameters import Parameter

#: rcl_interfaces/msg/Log
_LEVELS = {'debug': 10, 'info': 20, 'warn': 30, 'error': 40, 'fatal': 50}
#: rcl_interfaces/msg/ParameterType
_PARAMETER_TYPES = {
    bool: (1, 'bool'),
    int: (2, 'integer'),
    float: (3, 'double'),
    str: (4, 'string'),
}


class LocalNode:
    """A node's name, parameters, publishers and log.

    Attributes
    ----------
    parameters
        The values of its parameters, by name.

    Examples
    --------
    >>> from barc_sim.vehicle.parameters import Parameter
    >>> node = LocalHost(['-p', 'relay:steering:=0.2']).node('relay')
    >>> table = [Parameter('steering', 0.5, 'greatest front angle [rad]', (0.0, 1.5))]
    >>> node.declare(table, {})
    {'steering': 0.2}
    >>> node.tune(table, 'steering', 3.0)
    'parameter steering of relay must lie between 0.0 and 1.5: 3.0 does not'
    """

    def __init__(self, host: LocalHost, name: str) -> None:
        """Publish the parameters that every node has."""
        self.name = name
        self._host = host
        self._next: dict[str, float] = {}  # [s] by warning
        self._rosout = self.publisher('/rosout', 'rcl_interfaces/msg/Log')
        self._events = self.publisher('/parameter_events', 'rcl_interfaces/msg/ParameterEvent')
        self.parameters: dict[str, Any] = {}
        self._set(EVERY_NODES)

    def publisher(self, topic: str, type_name: str) -> Publisher:
        """Return a publisher on `topic`."""
        return self._host.topics.publisher(self.name, topic, type_name)

    def declare(self, table: Iterable[Parameter], given: Mapping[str, Any]) -> dict[str, Any]:
        """Declare the parameters of `table`, and return their values by name.

        Those that are `given` override the ROS arguments, which override the defaults.

        Raises
        ------
        UserError
            A value has the wrong type or is out of range.
        """
        values = checked(self.name, table, self._host.arguments.of(self.name) | dict(given))
        self._set(values)
        return values

    def tune(self, table: Iterable[Parameter], name: str, value: float) -> str:
        """Set a parameter of `table` while the run goes on; return why that is refused, or ''."""
        declared = next((each for each in table if each.name == name), None)
        if declared is None:
            return f'{self.name} has no parameter {name}'
        if declared.read_only:
            return f'parameter {name} of {self.name} is set at the start'
        try:
            self._set(checked(self.name, [declared], {name: value}), 'changed_parameters')
        except UserError as error:
            return str(error)
        self._host.changes.append((self.name, name, value))
        return ''

    def _set(self, values: Mapping[str, Any], kind: str = 'new_parameters') -> None:
        self.parameters |= values
        if not self._events.wanted:
            self._events.number += len(values)
            return
        value_class = message_class('rcl_interfaces/msg/ParameterValue')
        parameter_class = message_class('rcl_interfaces/msg/Parameter')
        for name, value in values.items():
            code, field = _PARAMETER_TYPES[type(value)]
            fields = _UNSET | {'type': code, f'{field}_value': value}
            event: dict[str, Any] = dict.fromkeys(_EVENT, ()) | {'node': f'/{self.name}'}
            event[kind] = [parameter_class(name=name, value=value_class(**fields))]
            self._events.publish(time.time_ns(), event)

    def info(self, text: str) -> None:
        """Log `text`."""
        self._log('info', text)

    def warning(self, text: str, period: float = 0.0) -> None:
        """Warn with `text`, once in `period` [s] at most."""
        kind, now = text.partition(' ')[0], time.monotonic()
        if now >= self._next.get(kind, 0.0):
            self._next[kind] = now + period
            self._log('warn', text)

    def error(self, text: str) -> None:
        """Log the error `text`."""
        self._log('error', text)

    def _log(self, level: str, text: str) -> None:
        number = _LEVELS[level]
        if number < _LEVELS.get(self._host.arguments.log_level, 0):
            return
        now = time.time_ns()
        print(f'[{level.upper()}] [{now / NANOSECONDS:.9f}] [{self.name}]: {text}', file=sys.stderr)  # noqa: T201
        place = {'file': '', 'function': '', 'line': 0}
        self._rosout.publish(now, {'level': number, 'name': self.name, 'msg': text, **place})


_EVENT = ('new_parameters', 'changed_parameters', 'deleted_parameters')
_UNSET = {
    'type': 0,
    'bool_value': False,
    'integer_value': 0,
    'double_value': 0.0,
    'string_value': '',
    'byte_array_value': np.zeros(0, np.uint8),
    'bool_array_value': np.zeros(0, np.bool_),
    'integer_array_value': np.zeros(0, np.int64),
    'double_array_value': np.zeros(0),
    'string_array_value': [],
}


class LocalHost:
    """The loop, the topics and the ROS arguments of a run.

    Attributes
    ----------
    nodes
        The nodes, in the order of their making.
    changes
        The parameters set while the run goes on: node, name and value.

    Examples
    --------
    >>> host = LocalHost([])
    >>> relay = host.node('relay')
    >>> [publisher.name for publisher in host.topics.publishers]
    ['/rosout', '/parameter_events']
    """

    def __init__(self, ros_args: Iterable[str]) -> None:
        """Take parameters from `ros_args`.

        Raises
        ------
        UserError
            An argument is not understood, or needs ROS.
        """
        self.arguments = RosArguments(ros_args)
        self.loop = Loop()
        self.topics = Topics()
        self.nodes: list[LocalNode] = []
        self.changes: deque[tuple[str, str, float]] = deque()

    def node(self, name: str) -> LocalNode:
        """Return a new node."""
        self.nodes.append(LocalNode(self, name))
        return self.nodes[-1]
