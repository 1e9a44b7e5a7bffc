"""The node `relay`: turns the driver's input, `cmd_vel`, into commands, `ecu`, at 20 Hz."""

from __future__ import annotations

from math import isfinite
from typing import TYPE_CHECKING, Any, ClassVar

from barc_interfaces.msg import ZDynBkMdl
from geometry_msgs.msg import Twist
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.serialization import deserialize_message
from std_srvs.srv import Trigger

from barc_sim.control.relay import PARAMETERS, RelayControl
from barc_sim.ros import names
from barc_sim.ros.conversions import to_driver_input
from barc_sim.ros.endpoints import drained_subscription, subscription
from barc_sim.ros.executor import QuickCallbackGroup
from barc_sim.ros.fields import FieldPublisher
from barc_sim.ros.parameters import declare
from barc_sim.simulation.log import MESSAGE_TYPES

if TYPE_CHECKING:
    from rclpy.parameter import Parameter as RosParameter

    from barc_sim.control.driver import Driver


class Relay(Node):
    """Publishes commands all the time: when nobody drives, the car coasts, or stops by `velocity`.

    It runs by the wall clock, as the driver does, at any real-time factor. Its commands have no
    stamp: each holds until the next one.

    Attributes
    ----------
    driver
        Makes the commands; its `request` and `servo` are those of the latest one.
    refused
        Twists that were not finite.
    inputs
        The topics that it subscribes to, with their types.

    Examples
    --------
    >>> import rclpy
    >>> from geometry_msgs.msg import Vector3
    >>> rclpy.init()
    >>> relay = Relay()
    >>> publisher = relay.create_publisher(Twist, 'cmd_vel', 1)
    >>> while not relay.driver.request.forward:
    ...     publisher.publish(Twist(linear=Vector3(x=1.0)))
    ...     rclpy.spin_once(relay, timeout_sec=0.1)
    >>> relay.driver.request
    DriverInput(forward=1.0, turn=0.0, brake=-0.0)
    >>> relay.destroy_node()
    >>> rclpy.shutdown()
    """

    inputs: ClassVar[dict[str, type[Any]]] = {names.CMD_VEL: Twist, names.STATE: ZDynBkMdl}

    def __init__(
        self,
        *,
        driver: Driver | None = None,
        **options: Any,  # noqa: ANN401 (Node's own)
    ) -> None:
        """Declare the parameters, and publish commands; `driver` replaces barc_sim's own.

        Raises
        ------
        UserError
            if a parameter is out of range.
        """
        super().__init__('relay', **options)
        self._control = RelayControl(driver, declare(self, PARAMETERS))
        self.driver = self._control.driver
        self.add_post_set_parameters_callback(self._on_parameters)
        self.refused = 0

        self._ecu_pub = FieldPublisher(self, names.ECU, MESSAGE_TYPES[names.ECU])
        group = QuickCallbackGroup()
        subscription(self, ZDynBkMdl, names.STATE, self._on_state, group, qos=names.QOS_NEWEST)
        drained_subscription(self, Twist, names.CMD_VEL, self._on_twist, group)
        self.create_service(Trigger, names.RESET_RELAY, self._on_reset, callback_group=group)
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(self.driver.dt, self._on_timer, group, steady)

    def _on_parameters(self, parameters: list[RosParameter]) -> None:
        self._control.configure({parameter.name: parameter.value for parameter in parameters})

    def _on_state(self, state: ZDynBkMdl) -> None:
        if isfinite(state.v_x):
            self._control.speed = state.v_x

    def _on_twist(self, data: bytes) -> None:
        twist = deserialize_message(data, Twist)
        if self._control.receive(to_driver_input(twist)):
            return
        if not self.refused:
            self.get_logger().warning(
                f'refused a Twist that is not finite: {twist.linear}, {twist.angular}; others are '
                'refused silently'
            )
        self.refused += 1

    def _on_reset(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        self._control.reset()
        response.success, response.message = True, 'as at the start'
        self.get_logger().debug('reset')
        return response

    def _on_timer(self) -> None:
        self._ecu_pub.publish(0, self._control.command()._asdict())
