"""The node `controller`: holds the speed, and the lane; a command answers each state."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any, ClassVar

from barc_interfaces.msg import ECU, ControllerState, EZDynBkMdl, LaneState, PidState, ZDynBkMdl
from nav_msgs.msg import Path
from rclpy.node import Node
from std_msgs.msg import Float64, Header
from std_srvs.srv import Trigger

from barc_sim.bags import names
from barc_sim.control.cruise_control import Answer, CruiseControl
from barc_sim.control.speed import ACCELERATION_LIMIT
from barc_sim.ros.node_helpers import (
    RefusedInput,
    Subscribed,
    declare,
    declare_track,
    frames,
    to_nanoseconds,
    to_path,
)

if TYPE_CHECKING:
    from collections.abc import Mapping

    from builtin_interfaces.msg import Time
    from rclpy.parameter import Parameter
    from rclpy.publisher import Publisher
    from rclpy.subscription import Subscription

    from barc_sim.control.speed import Controller
    from barc_sim.vehicle.track import Track

_STATES_A_PLAN = 5  #: RViz needs no more


class CruiseController(Node):
    """Answers each `z_vhcl` with an `ecu` of the same stamp; its dt is the difference of stamps.

    On a track it steers, too. Gains, reference and limits can be changed while it runs; the
    reference on the topic `speed_reference`, too, by an outer loop: the latest value holds.
    `values` are the parameters, `reference` the speed to hold after some time and at a place;
    `refused` counts references and states that were out of range.

    Examples
    --------
    >>> import rclpy
    >>> rclpy.init()
    >>> node = CruiseController()
    >>> _ = node.set_parameters([rclpy.Parameter('speed_reference', value=10.0)])
    >>> node.values['speed_reference']
    10.0
    >>> node.destroy_node()
    >>> rclpy.shutdown()
    """

    _error_sub: Subscription | None = None
    inputs: ClassVar = {names.STATE: ZDynBkMdl, names.SPEED_REFERENCE: Float64}

    def __init__(
        self,
        *,
        controller: Controller | None = None,
        track: Track | None = None,
        lane: object = None,
        acceleration_limit: float = ACCELERATION_LIMIT,
        **options: Any,  # noqa: ANN401 (Node's own)
    ) -> None:
        """Use `controller`, any object with the lab's `acc_calculate`; by default a parameter's.

        So are `track`, and `lane`, any object with `steer_calculate`. `acceleration_limit` [m/s²]
        is the default of the parameter.

        Raises
        ------
        UserError
            where a parameter is out of range, or `controller` cannot work with them.
        """
        super().__init__('controller', **options)
        self._subscribed, self.refused = Subscribed(self), RefusedInput(self)
        refuse, warn = self.refused.add, self.refused.warn
        track = declare_track(self, track)
        self._control = CruiseControl(
            controller, partial(declare, self), acceleration_limit, refuse, warn, track, lane
        )
        self.values, self.reference = self._control.values, self._control.reference
        self.lane = self._control.lane
        self.add_post_set_parameters_callback(self._on_parameters)

        topic, computed = names.PID_STATE, PidState
        if not self._control.is_pid:
            topic, computed = names.CONTROLLER_STATE, ControllerState
        self._map, base_link = frames(self)
        self._header = header = Header(frame_id=base_link)  # new messages would cost more
        self._ecu, self._computed = ECU(header=header), computed(header=header)
        self._computed_pub = self.create_publisher(computed, topic, names.QOS)
        self._lane_state, self._lane_pub = LaneState(header=header), None
        if self.lane:
            self._lane_pub = self.create_publisher(LaneState, names.LANE_STATE, names.QOS)
        self._plan_pub: Publisher | None = None
        self._states = 0
        if self.lane and self.lane.predicted():
            self._plan_pub = self.create_publisher(Path, names.PREDICTION, names.QOS)
        self._ecu_pub = self.create_publisher(ECU, names.ECU, names.QOS)
        self.create_subscription(ZDynBkMdl, names.STATE, self._on_state, names.QOS)
        self.create_subscription(Float64, names.SPEED_REFERENCE, self._on_speed, names.QOS_NEWEST)
        self._subscribe_to_errors()
        self.create_service(Trigger, names.RESET_CONTROLLER, self._on_reset)

    def _subscribe_to_errors(self) -> None:
        if self.values['subtract_error'] and not self._error_sub:
            self._error_sub = self.create_subscription(
                EZDynBkMdl, names.STATE_ERROR, self._on_state_error, names.QOS
            )

    def _on_parameters(self, parameters: list[Parameter]) -> None:
        self._control.configure({parameter.name: parameter.value for parameter in parameters})
        self._subscribe_to_errors()

    def _on_speed(self, message: Float64) -> None:
        self._control.refer(message.data)

    def _on_reset(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        self._control.reset()
        response.success, response.message = True, 'as at the start'
        return response

    def _on_state(self, state: ZDynBkMdl) -> None:
        stamp = to_nanoseconds(state.header.stamp)
        pose = state.x, state.y, state.psi
        self._publish(state.header.stamp, self._control.take_state(stamp, state.v_x, *pose))

    def _on_state_error(self, error: EZDynBkMdl) -> None:
        stamp = to_nanoseconds(error.header.stamp)
        self._publish(error.header.stamp, self._control.take_error(stamp, error.v_x))

    def _publish(self, stamp: Time, answer: Answer | None) -> None:
        if answer is None:
            return
        self._header.stamp = stamp
        self._ecu.motor, self._ecu.servo = answer.acceleration, answer.steering
        self._ecu_pub.publish(self._ecu)
        subscribed = self._subscribed.at(answer.stamp)
        if self._computed_pub in subscribed:
            _publish(self._computed_pub, self._computed, self._control.computed(answer))
        if self.lane and self._lane_pub in subscribed:
            _publish(self._lane_pub, self._lane_state, self.lane.computed())
        if self.lane and self._plan_pub and self._plan_pub in subscribed:
            if self._states % _STATES_A_PLAN == 0:
                header = Header(stamp=stamp, frame_id=self._map)
                self._plan_pub.publish(to_path(header, *self.lane.predicted()))
            self._states += 1


def _publish(publisher: Publisher, message: Any, fields: Mapping[str, Any]) -> None:  # noqa: ANN401
    for name, value in fields.items():
        setattr(message, name, value)
    publisher.publish(message)
