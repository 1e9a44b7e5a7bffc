"""The node `controller`: holds the speed, and the lane; answers each state with a command."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from barc_interfaces.msg import ECU, ControllerState, LaneState, PidState, ZDynBkMdl
from nav_msgs.msg import Path
from rclpy.node import Node
from std_msgs.msg import Float64, Header
from std_srvs.srv import Trigger

from barc_sim.control.cruise_control import CruiseControl
from barc_sim.control.speed import ACCELERATION_LIMIT
from barc_sim.interfaces import qos, services, topics
from barc_sim.interfaces.records import VehicleState
from barc_sim.interfaces.stamps import to_nanoseconds
from barc_sim.ros.conversions import frames
from barc_sim.ros.outputs import Outputs
from barc_sim.ros.parameters import declare, declare_track
from barc_sim.ros.poses import to_poses
from barc_sim.ros.refused_input import RefusedInput

if TYPE_CHECKING:
    from rclpy.parameter import Parameter

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

    def __init__(
        self,
        *,
        controller: object = None,
        track: Track | None = None,
        lane: object = None,
        acceleration_limit: float = ACCELERATION_LIMIT,
        **options: Any,  # noqa: ANN401 (Node's own)
    ) -> None:
        """Use `controller`: a `Pilot`, or any object with the lab's `acc_calculate`.

        On a `track`, `lane` steers: a `Pilot`, or any object with `steer_calculate`. By default the
        parameters choose all three. `acceleration_limit` [m/s²] is the default of its parameter.

        UserError: a parameter is out of range.
        """
        super().__init__('controller', **options)

        track = declare_track(self, track)
        self.refused = RefusedInput(self)
        self.control = CruiseControl(
            controller,
            declare=lambda parameters: declare(self, parameters),
            acceleration_limit=acceleration_limit,
            refuse=self.refused.add,
            warn=self.refused.warn,
            track=track,
            lane=lane,
        )
        self.values = self.control.values
        self.reference = self.control.reference
        self.lane = self.control.lane
        self.add_post_set_parameters_callback(self._on_parameters)

        map_frame, self._car_frame = frames(self)
        self._on_map = Header(frame_id=map_frame)
        self._ecu = ECU(header=Header(frame_id=self._car_frame))

        self._outputs = Outputs(self)
        self._add_outputs()
        self._ecu_pub = self.create_publisher(ECU, topics.ECU, qos.DEFAULT)

        self.create_subscription(ZDynBkMdl, topics.STATE, self._on_state, qos.DEFAULT)
        self.create_subscription(Float64, topics.SPEED_REFERENCE, self._on_speed, qos.NEWEST)

        self.create_service(Trigger, services.RESET_CONTROLLER, self._on_reset)

    def _add_outputs(self) -> None:
        """Add the messages that show how a command was computed."""
        on_car = Header(frame_id=self._car_frame)
        if self.control.is_pid:
            self._outputs.add(topics.PID_STATE, PidState(header=on_car), self.control.computed)
        else:
            self._outputs.add(
                topics.CONTROLLER_STATE, ControllerState(header=on_car), self.control.computed
            )
        if self.lane:
            self._outputs.add(topics.LANE_STATE, LaneState(header=on_car), self.lane.computed)
        if self.control.makes_plans:
            plan = Path(header=self._on_map)
            self._outputs.add(topics.PREDICTION, plan, self._predicted, every=5)

    def _predicted(self) -> dict[str, Any]:
        return to_poses(self._on_map, self.control.predicted())

    def _on_parameters(self, parameters: list[Parameter]) -> None:
        self.control.configure({parameter.name: parameter.value for parameter in parameters})

    def _on_speed(self, message: Float64) -> None:
        self.control.hold_speed(message.data)

    def _on_reset(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        self.control.reset()
        response.success = True
        response.message = 'the controller is reset'
        return response

    def _on_state(self, state: ZDynBkMdl) -> None:
        stamp = to_nanoseconds(state.header.stamp)
        measured = VehicleState(state.x, state.y, state.psi, state.v_x, state.v_y, state.psi_dot)
        command = self.control.take_state(stamp, measured)
        if command is None:
            return

        self._ecu.header.stamp = state.header.stamp
        self._ecu.motor = float(command.motor)
        self._ecu.servo = float(command.servo)
        self._ecu_pub.publish(self._ecu)
        self._outputs.publish(state.header.stamp)
