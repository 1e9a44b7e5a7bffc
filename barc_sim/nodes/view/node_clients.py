"""Clients of the services that a page's buttons and sliders call."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any

from rcl_interfaces.srv import GetParameters, SetParameters
from rclpy.parameter import Parameter, parameter_value_to_python
from std_srvs.srv import SetBool, Trigger

from barc_sim.page.protocol import CONTROLLER, SIMULATOR
from barc_sim.ros import names
from barc_sim.ros.executor import QuickCallbackGroup

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from rclpy.client import Client
    from rclpy.node import Node

    #: Called with whether the request succeeded, and if not, with the reason.
    OnDone = Callable[[bool, str], None]


_SERVICES = {
    names.RESET_SIMULATOR: Trigger,
    names.RESET_CONTROLLER: Trigger,
    names.PAUSE_SIMULATOR: SetBool,
    **{f'{node}/set_parameters': SetParameters for node in (CONTROLLER, SIMULATOR)},
    **{f'{node}/get_parameters': GetParameters for node in (CONTROLLER, SIMULATOR)},
}


class NodeClients:
    """Calls services of `vehicle_simulator` and `controller` without waiting for the responses.

    The callback of a response runs in the thread to which `deliver` passes it.
    """

    def __init__(self, node: Node, deliver: Callable[[Callable[[], object]], None]) -> None:
        """Create the clients of `node`."""
        self._node = node
        self._deliver = deliver
        group = QuickCallbackGroup()
        self._clients = {
            service: node.create_client(kind, service, callback_group=group)
            for service, kind in _SERVICES.items()
        }

    def reset(self, on_done: OnDone) -> None:
        """Reset the car to the start."""
        self._request(names.RESET_SIMULATOR, Trigger.Request(), _success, on_done)

    def reset_controller(self, on_done: OnDone) -> None:
        """Make the controller forget its past."""
        self._request(names.RESET_CONTROLLER, Trigger.Request(), _success, on_done)

    def pause(self, on: bool, on_done: OnDone) -> None:
        """Pause or resume simulated time."""
        self._request(names.PAUSE_SIMULATOR, SetBool.Request(data=on), _success, on_done)

    def tune(self, node: str, name: str, value: float, on_done: OnDone) -> None:
        """Set a parameter of a node."""
        parameter = Parameter(name, value=value).to_parameter_msg()
        request = SetParameters.Request(parameters=[parameter])
        self._request(f'{node}/set_parameters', request, _set_success, on_done)

    def parameters(
        self, node: str, names: Sequence[str], on_values: Callable[[dict[str, Any]], None]
    ) -> bool:
        """Request parameters of a node; False if it is not there."""
        client = self._clients[f'{node}/get_parameters']

        def on_response(response: GetParameters.Response) -> None:
            # A node that does not have one of the parameters sends no values at all.
            values = zip(names, map(parameter_value_to_python, response.values), strict=False)
            self._deliver(partial(on_values, dict(values)))

        return self._call(client, GetParameters.Request(names=names), on_response)

    def _request(
        self,
        service: str,
        request: Any,  # noqa: ANN401 (the service's own)
        success: Callable[[Any], tuple[bool, str]],
        on_done: OnDone,
    ) -> None:
        def on_response(response: Any) -> None:  # noqa: ANN401 (the service's own)
            self._deliver(partial(on_done, *success(response)))

        if not self._call(self._clients[service], request, on_response):
            name = self._node.resolve_service_name(service)
            self._deliver(partial(on_done, False, f'no node offers {name}'))

    def _call(self, client: Client, request: Any, on_response: Callable[[Any], None]) -> bool:  # noqa: ANN401
        """Call a service if it is there; `on_response` runs in the executor's thread."""
        if not client.service_is_ready():
            return False

        client.call_async(request).add_done_callback(lambda future: on_response(future.result()))
        return True


def _success(response: Trigger.Response | SetBool.Response) -> tuple[bool, str]:
    return bool(response.success), str(response.message)


def _set_success(response: SetParameters.Response) -> tuple[bool, str]:
    (result,) = response.results
    return bool(result.successful), str(result.reason)
