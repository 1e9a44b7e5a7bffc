"""The node `controller`: holds the speed; each state that arrives is answered by a command."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, Any

from barc_interfaces.msg import ECU, EZDynBkMdl, PidState, ZDynBkMdl
from rclpy.node import Node
from rclpy.serialization import deserialize_message
from std_msgs.msg import Float64
from std_srvs.srv import Trigger

from barc_sim.cli.parser import call
from barc_sim.control.pid import (
    ACCELERATION_LIMIT,
    FIRST_DT,
    KD,
    KI,
    KP,
    SPEED_REFERENCE,
    speed_controller,
)
from barc_sim.ros import names
from barc_sim.ros.conversions import NANOSECONDS, to_ecu, to_nanoseconds, to_pid_state
from barc_sim.ros.endpoints import drained_subscription, publisher, subscription
from barc_sim.ros.executor.executor import QuickCallbackGroup
from barc_sim.ros.parameters import declare
from barc_sim.ros.process import spin
from barc_sim.ros.warnings import RateLimitedWarning, RefusedInput
from barc_sim.vehicle.bike_model import Input
from barc_sim.vehicle.parameter import Parameter

if TYPE_CHECKING:
    from rclpy.parameter import Parameter as RosParameter

    from barc_sim.control.controller import Controller

_SPEEDS = (-100.0, 100.0)  #: [m/s]
_FASTEST = 1e6  #: [m/s] A state beyond is none.
_PARAMETERS = [
    Parameter('kp', KP, 'proportional gain [1/s]', (0.0, 1e6)),
    Parameter('ki', KI, 'integral gain [1/s²]', (0.0, 1e6)),
    Parameter('kd', KD, 'derivative gain [-]', (0.0, 1e6)),
    Parameter('speed_reference', SPEED_REFERENCE, 'the speed to hold [m/s]', _SPEEDS),
    Parameter(
        'acceleration_limit',
        ACCELERATION_LIMIT,
        'greatest acceleration commanded, either way [m/s²]',
        (0.01, 100.0),
    ),
    Parameter(
        'subtract_error',
        default=False,
        description='whether to control the true speed, z_vhcl minus ez_vhcl, not the measured',
    ),
]


class CruiseController(Node):
    """Answers each `z_vhcl` with an `ecu` of the same stamp; its dt is the difference of stamps.

    Gains, reference and limit may be changed while it runs; the reference on the topic
    `speed_reference`, too, by an outer loop: what came last, there or as parameter, holds.
    """

    def __init__(
        self,
        *,
        pid: Controller | None = None,
        **options: Any,  # noqa: ANN401 (Node's own)
    ) -> None:
        """Declare the parameters and wait for states; `pid` takes the place of barc_sim's own.

        Raises
        ------
        UserError
            where a parameter is out of range, or `pid` can't be had with them.
        """
        super().__init__('controller', **options)
        self._pid: Controller = pid or speed_controller()
        self._values = declare(self, _PARAMETERS)
        self._apply()
        self._pid.reset()
        self.add_post_set_parameters_callback(self._on_parameters)
        self._previous: int | None = None
        self._refusals = RefusedInput(self)
        self._gone_back = RateLimitedWarning(self)
        self._state: ZDynBkMdl | None = None
        self._error: EZDynBkMdl | None = None

        self._ecu_pub = publisher(self, ECU, names.ECU)
        self._pid_state_pub = publisher(self, PidState, names.PID_STATE)
        group = QuickCallbackGroup()
        for kind, topic, callback in (
            (EZDynBkMdl, names.STATE_ERROR, self._on_state_error),
            (ZDynBkMdl, names.STATE, self._on_state),
        ):
            drained_subscription(self, kind, topic, callback, group)
        subscription(
            self,
            Float64,
            names.SPEED_REFERENCE,
            self._on_speed_reference,
            group,
            qos=names.QOS_NEWEST,
        )
        self.create_service(Trigger, names.RESET_CONTROLLER, self._on_reset, callback_group=group)

    def _on_speed_reference(self, message: Float64) -> None:
        low, high = _SPEEDS
        if low <= message.data <= high:
            self._values['speed_reference'] = message.data
            return
        self._refusals.add(
            lambda: (
                f'a speed_reference of {message.data}: it must lie between {low:g} and {high:g} m/s'
            )
        )

    @property
    def refused(self) -> int:
        """References and states that were out of range."""
        return self._refusals.count

    @property
    def speed_reference(self) -> float:
        """The speed to hold [m/s]."""
        return float(self._values['speed_reference'])

    def _on_parameters(self, parameters: list[RosParameter]) -> None:
        self._values.update({parameter.name: parameter.value for parameter in parameters})
        self._apply()

    def _apply(self) -> None:
        pid, values = self._pid, self._values
        pid.kp, pid.ki, pid.kd = values['kp'], values['ki'], values['kd']
        pid.output_max = values['acceleration_limit']
        pid.output_min = -pid.output_max

    def _on_reset(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        self._pid.reset()
        self._previous = self._state = self._error = None
        response.success, response.message = True, 'as at the start'
        self.get_logger().debug('reset')
        return response

    def _on_state(self, data: bytes) -> None:
        state = deserialize_message(data, ZDynBkMdl)
        if self._values['subtract_error']:
            self._state = state
            self._join()
        else:
            self._answer(state, state.v_x)

    def _on_state_error(self, data: bytes) -> None:
        if self._values['subtract_error']:
            self._error = deserialize_message(data, EZDynBkMdl)
            self._join()

    def _join(self) -> None:
        """Answer once the state and the error of the same stamp are both there."""
        state, error = self._state, self._error
        if state and error and state.header.stamp == error.header.stamp:
            self._answer(state, state.v_x - error.v_x)

    def _answer(self, state: ZDynBkMdl, speed: float) -> None:
        if not abs(speed) <= _FASTEST:  # NaN, too
            self._refusals.add(lambda: f'a state whose speed is {speed} m/s')
            return
        stamp = to_nanoseconds(state.header.stamp)
        dt = FIRST_DT
        if self._previous is not None:
            dt = (stamp - self._previous) / NANOSECONDS
            if dt < 0.0:
                back = -dt
                self._gone_back.warn(lambda: f'time has gone back by {back:g} s: the PID is reset')
                self._pid.reset()
                dt = FIRST_DT
        self._previous = stamp

        reference = self.speed_reference
        acceleration = self._pid.acc_calculate(reference, speed, dt)
        self._ecu_pub.publish(to_ecu(Input(motor=acceleration), state.header))
        self._pid_state_pub.publish(
            to_pid_state(self._pid, reference, speed, acceleration, state.header)
        )


def main(args: list[str] | None = None) -> int:
    """Run the node alone, until it is told to stop."""
    return call('controller', lambda: spin(CruiseController, args))


if __name__ == '__main__':
    sys.exit(main())
