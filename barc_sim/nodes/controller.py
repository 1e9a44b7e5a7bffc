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
from barc_sim.control.adapter import as_controller
from barc_sim.control.pid import ACCELERATION_LIMIT, FIRST_DT, NO_LIMIT, SPEED_REFERENCE
from barc_sim.control.types import DEFAULT_TYPE, TYPES
from barc_sim.errors import UserError
from barc_sim.ros import names
from barc_sim.ros.conversions import (
    NANOSECONDS,
    controller_state_type,
    to_controller_state,
    to_ecu,
    to_nanoseconds,
)
from barc_sim.ros.endpoints import drained_subscription, publisher, subscription
from barc_sim.ros.executor import QuickCallbackGroup
from barc_sim.ros.parameters import declare
from barc_sim.ros.process import spin
from barc_sim.ros.warnings import RateLimitedWarning, RefusedInput
from barc_sim.vehicle.bike_model import Input
from barc_sim.vehicle.parameters import Parameter

if TYPE_CHECKING:
    from rclpy.parameter import Parameter as RosParameter

    from barc_sim.control.controller import Controller

_SPEEDS = (-100.0, 100.0)  #: [m/s]
_FASTEST = 1e6  #: [m/s] A faster state is refused.
_TYPE = Parameter(
    'controller_type', DEFAULT_TYPE, f'which controller: {", ".join(TYPES)}', read_only=True
)
_PARAMETERS = [
    Parameter('speed_reference', SPEED_REFERENCE, 'the speed to hold [m/s]', _SPEEDS),
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
        controller: Controller | None = None,
        acceleration_limit: float = ACCELERATION_LIMIT,
        **options: Any,  # noqa: ANN401 (Node's own)
    ) -> None:
        """Declare the parameters and wait for states.

        `controller` takes the place of the one that the parameter `controller_type` names; any
        object with the lab's `acc_calculate` works. `acceleration_limit` is the default of that
        parameter.

        Raises
        ------
        UserError
            where a parameter is out of range, or `controller` cannot work with them.
        """
        super().__init__('controller', **options)
        self._controller = self._new() if controller is None else as_controller(controller)
        gains = [
            Parameter(
                name,
                float(getattr(self._controller, name)),
                f'{gain.meaning} [{gain.unit}]',
                gain.between,
            )
            for name, gain in self._controller.gains.items()
        ]
        limit = Parameter(
            'acceleration_limit',
            acceleration_limit,
            'greatest acceleration commanded, either way [m/s²]',
            (0.01, NO_LIMIT),
        )
        self._values = declare(self, [*gains, limit, *_PARAMETERS])
        self._apply()
        self._controller.reset()
        self.add_post_set_parameters_callback(self._on_parameters)
        self._previous: int | None = None
        self._refusals = RefusedInput(self)
        self._gone_back = RateLimitedWarning(self)
        self._state: ZDynBkMdl | None = None
        self._error: EZDynBkMdl | None = None

        self._ecu_pub = publisher(self, ECU, names.ECU)
        state_type = controller_state_type(self._controller)
        topic = names.PID_STATE if state_type is PidState else names.CONTROLLER_STATE
        self._controller_state_pub = publisher(self, state_type, topic)
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

    def _new(self) -> Controller:
        """Return a controller of the type that the parameter names.

        Raises
        ------
        UserError
            where there is no such type.
        """
        name = declare(self, [_TYPE])['controller_type']
        if name not in TYPES:
            raise UserError(
                f'parameter controller_type of {self.get_name()} is {name!r}: expected '
                f'{" or ".join(TYPES)}'
            )
        return TYPES[name]()

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
        controller, values = self._controller, self._values
        for name in controller.gains:
            setattr(controller, name, values[name])
        controller.output_max = values['acceleration_limit']
        controller.output_min = -controller.output_max

    def _on_reset(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        self._controller.reset()
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
                self._gone_back.warn(
                    lambda: f'time went back by {back:g} s: the controller is reset'
                )
                self._controller.reset()
                dt = FIRST_DT
        self._previous = stamp

        reference = self.speed_reference
        acceleration = self._controller.acc_calculate(reference, speed, dt)
        self._ecu_pub.publish(to_ecu(Input(motor=acceleration), state.header))
        self._controller_state_pub.publish(
            to_controller_state(self._controller, reference, speed, acceleration, state.header)
        )


def main(args: list[str] | None = None) -> int:
    """Run the node alone, until a signal stops it."""
    return call('controller', lambda: spin(CruiseController, args))


if __name__ == '__main__':
    sys.exit(main())
