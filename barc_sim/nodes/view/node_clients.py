"""What the live page asks of the other nodes: parameters, reset and pause."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any

from rcl_interfaces.srv import GetParameters, SetParameters
from rclpy.parameter import Parameter, parameter_value_to_python
from std_srvs.srv import SetBool, Trigger

from barc_sim.ros.executor.executor import QuickCallbackGroup

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from rclpy.client import Client
    from rclpy.node import Node

    #: Told whether it was done, and if not, why.
    Answer = Callable[[bool, str], None]


_RESET = 'vehicle_simulator/reset'
_PAUSE = 'vehicle_simulator/pause'
_SET = 'controller/set_parameters'
_SERVICES = {
    _RESET: Trigger,
    _PAUSE: SetBool,
    _SET: SetParameters,
    'controller/get_parameters': GetParameters,
    'vehicle_simulator/get_parameters': GetParameters,
}


class Peers:
    """Calls the services of `vehicle_simulator` and `controller`, without waiting for them.

    Answers come in whatever thread `deliver` brings them to.
    """

    def __init__(self, node: Node, deliver: Callable[[Callable[[], object]], None]) -> None:
        """Ask as `node`."""
        self._node = node
        self._deliver = deliver
        group = QuickCallbackGroup()
        self._clients = {
            service: node.create_client(kind, service, callback_group=group)
            for service, kind in _SERVICES.items()
        }

    def reset(self, answer: Answer) -> None:
        """Put the car back to the start."""
        self._ask(_RESET, Trigger.Request(), _whether_done, answer)

    def pause(self, on: bool, answer: Answer) -> None:
        """Stop simulated time, or let it go on."""
        self._ask(_PAUSE, SetBool.Request(data=on), _whether_done, answer)

    def tune(self, name: str, value: float, answer: Answer) -> None:
        """Set a parameter of the controller."""
        parameter = Parameter(name, value=value).to_parameter_msg()
        self._ask(_SET, SetParameters.Request(parameters=[parameter]), _whether_set, answer)

    def parameters(
        self, node: str, names: Sequence[str], answer: Callable[[dict[str, Any]], None]
    ) -> bool:
        """Ask `vehicle_simulator` or `controller` for parameters; False where it isn't there."""
        client = self._clients[f'{node}/get_parameters']

        def told(response: GetParameters.Response) -> None:
            # Where one is unknown, the node tells none.
            known = zip(names, map(parameter_value_to_python, response.values), strict=False)
            self._deliver(partial(answer, dict(known)))

        return self._call(client, GetParameters.Request(names=names), told)

    def _ask(
        self,
        service: str,
        request: Any,  # noqa: ANN401 (the service's own)
        verdict: Callable[[Any], tuple[bool, str]],
        answer: Answer,
    ) -> None:
        client = self._clients[service]
        if not self._call(
            client, request, lambda response: self._deliver(partial(answer, *verdict(response)))
        ):
            name = self._node.resolve_service_name(service)
            self._deliver(partial(answer, False, f'nobody offers {name}'))

    def _call(self, client: Client, request: Any, told: Callable[[Any], None]) -> bool:  # noqa: ANN401
        """Call a service, if it is there; `told` is called in the executor's thread."""
        if not client.service_is_ready():
            return False

        client.call_async(request).add_done_callback(lambda future: told(future.result()))
        return True


def _whether_done(response: Trigger.Response | SetBool.Response) -> tuple[bool, str]:
    return bool(response.success), str(response.message)


def _whether_set(response: SetParameters.Response) -> tuple[bool, str]:
    (result,) = response.results
    return bool(result.successful), str(result.reason)
