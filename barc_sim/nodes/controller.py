"""The node `controller`: holds the speed, and the lane; answers each state with a command."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any, ClassVar

from barc_interfaces.msg import ECU, ControllerState, LaneState, PidState, ZDynBkMdl
from nav_msgs.msg import Path
from rclpy.node import Node
from std_msgs.msg import Float64, Header
from std_srvs.srv import Trigger

from barc_sim.bags import names
from barc_sim.bags.messages import to_nanoseconds
from barc_sim.control.cruise_control import CruiseControl
from barc_sim.control.speed import ACCELERATION_LIMIT
from barc_sim.ros.node_helpers import (
    Outputs,
    RefusedInput,
    declare,
    declare_track,
    frames,
    to_poses,
)

if TYPE_CHECKING:
    from rclpy.parameter import Parameter

    from barc_sim.control.speed import Controller
    from barc_sim.vehicle.track import Track


class CruiseController(Node):
    """Answers each `z_vhcl` with an `ecu` of the same stamp; its dt is the difference of stamps.

    On a track it also steers. Parameters can be changed during the run: `values` has the present
    ones. `control` computes; `reference` returns the speed to hold; `refused` counts invalid
    messages.

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
        """Use `controller`, any object with the lab's `acc_calculate`.

        On a `track`, `lane` steers: any object with `steer_calculate`. By default the parameters
        choose all three. `acceleration_limit` [m/s²] is the default of its parameter.

        UserError: a parameter is out of range.
        """
        super().__init__('controller', **options)
        self.refused, track = RefusedInput(self), declare_track(self, track)
        refuse, warn = self.refused.add, self.refused.warn
        self.control = control = CruiseControl(
            controller, partial(declare, self), acceleration_limit, refuse, warn, track, lane
        )
        self.values, self.reference = control.values, control.reference
        self.lane = keeping = control.lane
        self.add_post_set_parameters_callback(self._on_parameters)

        on_map, on_car = (Header(frame_id=frame) for frame in frames(self))
        self._ecu, self._outputs = ECU(header=on_car), Outputs(self)
        kind, topic = PidState, names.PID_STATE
        if not control.is_pid:
            kind, topic = ControllerState, names.CONTROLLER_STATE
        self._outputs.add(topic, kind(header=on_car), control.computed)
        if keeping:
            self._outputs.add(names.LANE_STATE, LaneState(header=on_car), keeping.computed)
        if keeping and keeping.predicted():
            plan, poses = Path(header=on_map), lambda: to_poses(on_map, keeping.predicted())
            self._outputs.add(names.PREDICTION, plan, poses, every=5)
        self._ecu_pub = self.create_publisher(ECU, names.ECU, names.QOS)
        self.create_subscription(ZDynBkMdl, names.STATE, self._on_state, names.QOS)
        self.create_subscription(Float64, names.SPEED_REFERENCE, self._on_speed, names.QOS_NEWEST)
        self.create_service(Trigger, names.RESET_CONTROLLER, self._on_reset)

    def _on_parameters(self, parameters: list[Parameter]) -> None:
        self.control.configure({parameter.name: parameter.value for parameter in parameters})

    def _on_speed(self, message: Float64) -> None:
        self.control.refer(message.data)

    def _on_reset(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        self.control.reset()
        response.success, response.message = True, 'the controller is reset'
        return response

    def _on_state(self, state: ZDynBkMdl) -> None:
        stamp, pose = to_nanoseconds(state.header.stamp), (state.x, state.y, state.psi)
        if answer := self.control.take_state(stamp, state.v_x, *pose):
            self._ecu.header.stamp = state.header.stamp
            self._ecu.motor, self._ecu.servo = answer.acceleration, answer.steering
            self._ecu_pub.publish(self._ecu)
            self._outputs.publish(state.header.stamp)
