"""Reads and sets the parameters of a running node."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from rclpy.parameter import Parameter, parameter_value_to_python
from rclpy.parameter_client import AsyncParameterClient

from barc_sim.cli.parser import did_you_mean
from barc_sim.errors import UserError
from barc_sim.ros.introspection.parameter_text import TYPES, in_yaml, suggestion

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rcl_interfaces.msg import ParameterDescriptor, ParameterValue

    from barc_sim.ros.introspection.observer import GraphObserver


class Verdict(NamedTuple):
    """Whether a parameter was set."""

    name: str
    done: bool
    reason: str  #: why it was not set; or a remark


class Parameters:
    """The parameters of a node.

    Attributes
    ----------
    node
        The node's full name.
    """

    def __init__(self, observer: GraphObserver, node: str) -> None:
        """Find the node's services.

        Raises
        ------
        UserError
            where the node does not exist, or has no parameter services.
        """
        self.node = observer.find_node(node)
        self._observer = observer
        self._client = AsyncParameterClient(observer.node, self.node)
        if not observer.wait_for(self._client.services_are_ready):
            raise UserError(f'{self.node} has no parameter services')

    def names(self) -> list[str]:
        """Return the names of all parameters, in order."""
        response = self._observer.request(self._client.list_parameters, self.node)
        return sorted(response.result.names)

    def values(self, names: Sequence[str]) -> list[ParameterValue]:
        """Return the values of the named parameters.

        Raises
        ------
        UserError
            where one of them is not declared.
        """
        self._check(names)
        if not names:
            return []
        response = self._observer.request(lambda: self._client.get_parameters(names), self.node)
        return list(response.values)

    def descriptors(self, names: Sequence[str]) -> list[ParameterDescriptor]:
        """Return the descriptors of the named parameters; of all without names.

        Raises
        ------
        UserError
            where one of them is not declared.
        """
        names = names or self.names()
        self._check(names)
        response = self._observer.request(
            lambda: self._client.describe_parameters(names), self.node
        )
        return list(response.descriptors)

    def set(self, wanted: dict[str, ParameterValue]) -> list[Verdict]:
        """Set parameters, each on its own, and return the verdicts."""
        declared = self.names()
        known = [name for name in wanted if name in declared]
        descriptors = dict(zip(known, self.descriptors(known) if known else [], strict=True))
        current = dict(zip(known, self.values(known), strict=True))
        verdicts = {name: Verdict(name, False, self._unknown(name, declared)) for name in wanted}
        sent = {}
        for name in known:
            descriptor, value = descriptors[name], wanted[name]
            if descriptor.read_only and current[name] == value:
                verdicts[name] = Verdict(name, True, 'read-only, and unchanged')
            elif reason := self._refusal(descriptor, value):
                verdicts[name] = Verdict(name, False, reason)
            else:
                sent[name] = Parameter(name, value=parameter_value_to_python(value))
        if sent:
            parameters = list(sent.values())
            response = self._observer.request(
                lambda: self._client.set_parameters(parameters), self.node
            )
            for name, result in zip(sent, response.results, strict=True):
                reason = result.reason
                if not result.successful:
                    reason = (
                        f'{self.node} refused the value of {name}: {reason or "without a reason"}'
                    )
                verdicts[name] = Verdict(name, result.successful, reason)
        return list(verdicts.values())

    def _refusal(self, descriptor: ParameterDescriptor, value: ParameterValue) -> str:
        """Return why the node would refuse `value`, as far as its descriptor shows; or ''."""
        owner = f'parameter {descriptor.name} of {self.node}'
        given = parameter_value_to_python(value)
        if value.type != descriptor.type and not descriptor.dynamic_typing:
            return (
                f'{owner} is of type {TYPES[descriptor.type]}, and {in_yaml(given)} is of type '
                f'{TYPES[value.type]}{suggestion(descriptor.type, given)}'
            )
        if descriptor.read_only:
            setting = f'{self.node.rpartition("/")[2]}:{descriptor.name}:={in_yaml(given)}'
            return f'{owner} is read-only: set it at the start (--ros-args -p {setting})'
        return ''

    def _check(self, names: Sequence[str]) -> None:
        declared = self.names()
        for name in names:
            if name not in declared:
                raise UserError(self._unknown(name, declared))

    def _unknown(self, name: str, declared: list[str]) -> str:
        hint = did_you_mean(name, declared) or f': it has {", ".join(declared)}'
        return f'{self.node} has no parameter {name}{hint}'
