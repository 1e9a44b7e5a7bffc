"""The parameters of a running node: looked at and set, with errors that say what to do."""

from __future__ import annotations

from difflib import get_close_matches
from typing import TYPE_CHECKING, NamedTuple

from rclpy.parameter import Parameter, parameter_value_to_python
from rclpy.parameter_client import AsyncParameterClient

from barc_sim.errors import UserError
from barc_sim.ros.introspection.parameter_text import TYPES, in_yaml, instead

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rcl_interfaces.msg import ParameterDescriptor, ParameterValue

    from barc_sim.ros.introspection.observer import Look


class Verdict(NamedTuple):
    """What became of a parameter that was to be set."""

    name: str
    done: bool
    why: str  #: in a sentence, where it was not done; or a remark


class Parameters:
    """Those of a node.

    Attributes
    ----------
    node
        The node's full name.
    """

    def __init__(self, look: Look, node: str) -> None:
        """Find the node's services.

        Raises
        ------
        UserError
            where there is no such node, or it has none of them.
        """
        self.node = look.peer(node)
        self._look = look
        self._client = AsyncParameterClient(look.node, self.node)
        if not look.until(self._client.services_are_ready):
            raise UserError(f'{self.node} has no parameter services: it keeps its own')

    def names(self) -> list[str]:
        """Return the names of all, in order."""
        response = self._look.answer(self._client.list_parameters, self.node)
        return sorted(response.result.names)

    def values(self, names: Sequence[str]) -> list[ParameterValue]:
        """Return the values of these.

        Raises
        ------
        UserError
            where one of them isn't declared.
        """
        self._check(names)
        if not names:
            return []
        response = self._look.answer(lambda: self._client.get_parameters(names), self.node)
        return list(response.values)

    def descriptors(self, names: Sequence[str]) -> list[ParameterDescriptor]:
        """Return what is to be known of these; of all without names.

        Raises
        ------
        UserError
            where one of them isn't declared.
        """
        names = names or self.names()
        self._check(names)
        response = self._look.answer(lambda: self._client.describe_parameters(names), self.node)
        return list(response.descriptors)

    def set(self, wanted: dict[str, ParameterValue]) -> list[Verdict]:
        """Set parameters, each for itself, and return what became of them."""
        declared = self.names()
        known = [name for name in wanted if name in declared]
        descriptors = dict(zip(known, self.descriptors(known) if known else [], strict=True))
        current = dict(zip(known, self.values(known), strict=True))
        verdicts = {name: Verdict(name, False, self._unknown(name, declared)) for name in wanted}
        sent = {}
        for name in known:
            descriptor, value = descriptors[name], wanted[name]
            if descriptor.read_only and current[name] == value:
                verdicts[name] = Verdict(name, True, 'read-only, and as it was')
            elif why := self._refusal(descriptor, value):
                verdicts[name] = Verdict(name, False, why)
            else:
                sent[name] = Parameter(name, value=parameter_value_to_python(value))
        if sent:
            parameters = list(sent.values())
            response = self._look.answer(lambda: self._client.set_parameters(parameters), self.node)
            for name, result in zip(sent, response.results, strict=True):
                why = result.reason
                if not result.successful:
                    why = f'{self.node} refused the value of {name}: {why or "it gives no reason"}'
                verdicts[name] = Verdict(name, result.successful, why)
        return list(verdicts.values())

    def _refusal(self, descriptor: ParameterDescriptor, value: ParameterValue) -> str:
        """Return why the node will not take `value`, as far as it can be told before."""
        owner = f'parameter {descriptor.name} of {self.node}'
        given = parameter_value_to_python(value)
        if value.type != descriptor.type and not descriptor.dynamic_typing:
            return (
                f'{owner} is of type {TYPES[descriptor.type]}, and {in_yaml(given)} is of type '
                f'{TYPES[value.type]}{instead(descriptor.type, given)}'
            )
        if descriptor.read_only:
            setting = f'{self.node.rpartition("/")[2]}:{descriptor.name}:={in_yaml(given)}'
            return f'{owner} is read-only: give it at the start (--ros-args -p {setting})'
        return ''

    def _check(self, names: Sequence[str]) -> None:
        declared = self.names()
        for name in names:
            if name not in declared:
                raise UserError(self._unknown(name, declared))

    def _unknown(self, name: str, declared: list[str]) -> str:
        close = get_close_matches(name, declared)
        hint = f'did you mean {" or ".join(close)}?' if close else f'it has {", ".join(declared)}'
        return f'{self.node} has no parameter {name}: {hint}'
