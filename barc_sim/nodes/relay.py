"""The node `relay`: turns the driver's input, `cmd_vel`, into commands, `ecu`, at 20 Hz."""

from __future__ import annotations

import sys
import time
from math import isfinite
from typing import TYPE_CHECKING, Any

from barc_interfaces.msg import ECU, ZDynBkMdl
from geometry_msgs.msg import Twist
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.serialization import deserialize_message
from std_msgs.msg import Header
from std_srvs.srv import Trigger

from barc_sim.cli.parser import call
from barc_sim.control.driver import STALE_AFTER, Driver, Limits
from barc_sim.ros import names
from barc_sim.ros.conversions import to_driver_input, to_ecu
from barc_sim.ros.endpoints import drained_subscription, publisher, subscription
from barc_sim.ros.executor import QuickCallbackGroup
from barc_sim.ros.parameters import declare
from barc_sim.ros.process import spin
from barc_sim.vehicle.parameters import Parameter

if TYPE_CHECKING:
    from rclpy.parameter import Parameter as RosParameter

_LIMITS = Limits()
_PARAMETERS = [
    Parameter('acceleration', _LIMITS.acceleration, 'greatest acceleration [m/s²]', (0.0, 100.0)),
    Parameter('deceleration', _LIMITS.deceleration, 'greatest deceleration [m/s²]', (0.0, 100.0)),
    Parameter('speed', _LIMITS.speed, 'greatest speed, either way [m/s]', (0.0, 100.0)),
    Parameter('steering', _LIMITS.steering, 'greatest front angle, either way [rad]', (0.0, 1.5)),
    Parameter(
        'steering_rate',
        _LIMITS.steering_rate,
        'greatest change of the front angle [rad/s]',
        (0.0, 100.0),
    ),
    Parameter(
        'self_centring',
        _LIMITS.self_centring,
        'whether the wheel returns to straight when released; if not, left and right change its '
        'angle, and it stays',
    ),
    Parameter('linear_scale', 1.0, 'share of the limits for a linear of 1', (-100.0, 100.0)),
    Parameter('angular_scale', 1.0, 'share of the limits for an angular of 1', (-100.0, 100.0)),
    Parameter('stale_after', STALE_AFTER, 'age above which a Twist is ignored [s]', (0.05, 60.0)),
]


class Relay(Node):
    """Publishes commands all the time: coasting when nobody drives.

    It runs by the wall clock, as the driver does, at any real-time factor. Its commands have no
    stamp: each holds until the next one.

    Attributes
    ----------
    driver
        Makes the commands; its `request` and `servo` are those of the latest one.
    refused
        Twists that were not finite.
    """

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
        self.driver = driver or Driver()
        self._values = declare(self, _PARAMETERS)
        self._apply()
        self.add_post_set_parameters_callback(self._on_parameters)
        self._speed = 0.0
        self.refused = 0

        self._ecu_pub = publisher(self, ECU, names.ECU)
        group = QuickCallbackGroup()
        subscription(self, ZDynBkMdl, names.STATE, self._on_state, group, qos=names.QOS_NEWEST)
        drained_subscription(self, Twist, names.CMD_VEL, self._on_twist, group)
        self.create_service(Trigger, names.RESET_RELAY, self._on_reset, callback_group=group)
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(self.driver.dt, self._on_timer, group, steady)

    def _on_parameters(self, parameters: list[RosParameter]) -> None:
        self._values.update({parameter.name: parameter.value for parameter in parameters})
        self._apply()

    def _apply(self) -> None:
        self.driver.limits = Limits(*(self._values[name] for name in Limits._fields))
        self.driver.stale_after = self._values['stale_after']

    def _on_state(self, state: ZDynBkMdl) -> None:
        if isfinite(state.v_x):
            self._speed = state.v_x

    def _on_twist(self, data: bytes) -> None:
        twist = deserialize_message(data, Twist)
        request = to_driver_input(
            twist, self._values['linear_scale'], self._values['angular_scale']
        )
        if request.usable:
            self.driver.receive(request, time.monotonic())
            return
        if not self.refused:
            self.get_logger().warning(
                f'refused a Twist that is not finite: {twist.linear}, {twist.angular}; others are '
                'refused silently'
            )
        self.refused += 1

    def _on_reset(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        self.driver.reset()
        self._speed = 0.0
        response.success, response.message = True, 'as at the start'
        self.get_logger().debug('reset')
        return response

    def _on_timer(self) -> None:
        command = self.driver.command(time.monotonic(), self._speed)
        self._ecu_pub.publish(to_ecu(command, Header()))


def main(args: list[str] | None = None) -> int:
    """Run the node alone, until it is stopped."""
    return call('relay', lambda: spin(Relay, args))


if __name__ == '__main__':
    sys.exit(main())
