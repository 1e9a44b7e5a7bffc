"""The node `relay`: turns the driver's input, `cmd_vel`, into commands, `ecu`, at 20 Hz."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Any

from barc_interfaces.msg import ECU, ZDynBkMdl
from geometry_msgs.msg import Twist
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from std_msgs.msg import Header
from std_srvs.srv import Trigger

from barc_sim.control.driver import PARAMETERS, Driver
from barc_sim.interfaces import qos, services, topics
from barc_sim.ros.conversions import fill, frames, to_driver_input
from barc_sim.ros.parameters import declare
from barc_sim.ros.refused_input import RefusedInput

if TYPE_CHECKING:
    from rclpy.parameter import Parameter


class Relay(Node):
    """Publishes commands all the time: without a driver's input the car coasts.

    It runs by the wall clock at any real-time factor, as the driver does. Its commands have no
    stamp: each is applied until the next one arrives. `driver` computes them; `refused` counts
    invalid Twists.

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

    def __init__(self, *, driver: Driver | None = None, **options: Any) -> None:  # noqa: ANN401
        """Declare the parameters, and publish commands; `driver` replaces barc_sim's own.

        UserError: a parameter is out of range.
        """
        super().__init__('relay', **options)

        self.driver = driver or Driver()
        self.driver.configure(declare(self, PARAMETERS))
        self.add_post_set_parameters_callback(self._on_parameters)
        self._speed = 0.0
        self.refused = RefusedInput(self)

        _, car_frame = frames(self)
        self._ecu = ECU(header=Header(frame_id=car_frame))
        self._ecu_pub = self.create_publisher(ECU, topics.ECU, qos.DEFAULT)

        self.create_subscription(ZDynBkMdl, topics.STATE, self._on_state, qos.NEWEST)
        self.create_subscription(Twist, topics.CMD_VEL, self._on_twist, qos.DEFAULT)

        self.create_service(Trigger, services.RESET_RELAY, self._on_reset)

        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(self.driver.dt, self._on_timer, clock=steady)

    def _on_parameters(self, parameters: list[Parameter]) -> None:
        self.driver.configure({parameter.name: parameter.value for parameter in parameters})

    def _on_state(self, state: ZDynBkMdl) -> None:
        self._speed = state.v_x

    def _on_twist(self, twist: Twist) -> None:
        if not self.driver.receive(to_driver_input(twist), time.monotonic()):
            self.refused.add(lambda: f'a Twist that is not finite: {twist.linear}, {twist.angular}')

    def _on_reset(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        self.driver.reset()
        self._speed = 0.0
        response.success = True
        response.message = 'the relay is reset'
        return response

    def _on_timer(self) -> None:
        command = self.driver.command(time.monotonic(), self._speed)
        self._ecu_pub.publish(fill(self._ecu, command))
