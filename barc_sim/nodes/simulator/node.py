"""The node `vehicle_simulator`: owns time, and steps the car with the commands that it receives."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any, ClassVar

from barc_interfaces.msg import ECU
from geometry_msgs.msg import PoseWithCovarianceStamped
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.task import Future
from std_srvs.srv import SetBool, Trigger

from barc_sim.bags.cdr import leading_time
from barc_sim.errors import UserError
from barc_sim.nodes.simulator.peers import PeerWatch, StartGate
from barc_sim.ros import names
from barc_sim.ros.conversions import to_state_at_rest
from barc_sim.ros.endpoints import drained_subscription, subscription
from barc_sim.ros.executor import QuickCallbackGroup
from barc_sim.ros.fields import FieldPublisher, field_reader
from barc_sim.ros.parameters import declare
from barc_sim.ros.peers import claim, living_publishers, taken
from barc_sim.ros.warnings import RefusedInput
from barc_sim.simulation.publishers import StatePublishers
from barc_sim.simulation.simulator import (
    CHECK_PERIOD,
    Simulator,
    commands_lost,
    missed_deadline,
    parameters,
    publishes_clock,
    stamps_behind,
)
from barc_sim.vehicle.bike_model import Command, bikeFE

if TYPE_CHECKING:
    from collections.abc import Callable

    from rclpy.parameter import Parameter as RosParameter

    from barc_sim.vehicle.bike_model import Model
    from barc_sim.vehicle.plant import Observation
    from barc_sim.vehicle.road import Road


class VehicleSimulator(Simulator, Node):
    """Publishes the state, and steps it with the command that answers it.

    State `k` is stamped `t_0 + k·T_s`. With a real-time factor the command for state `k` is due
    when state `k + 1` is. If it has not arrived, the last one holds, and `missed` counts it. If
    the simulator itself is late, simulated time stands still for whole periods, and `slipped`
    counts them. In lock-step (`realtime_factor` 0) each step is taken as soon as its command has
    arrived. The rules are those of `barc_sim.simulation.stepper.Stepper`; this node converts,
    calls and publishes.

    A command answers the state with the same stamp. A command without a stamp, as `ros2 topic pub`
    sends it, holds until the next one, and none is missed meanwhile. If no command arrives for
    `command_timeout` by the wall clock, the car brakes to a standstill and stays there.

    If `realtime_factor` is not 1, or the parameter `clock` is true, each state's stamp is published
    on `/clock` before the state, for nodes with `use_sim_time`, and repeated every second while
    time stands still. At factor 1 this begins once a pause or slips have left stamps more than
    0.1 s behind the wall clock.

    The service `reset` restarts the run once the present state is answered: state, held command
    and noise are as at first, the controller or relay is reset, too, and stamps continue. So does
    each of the `laps` at its end, a state at or beyond `distance`. The
    service `pause` stops and resumes simulated time; meanwhile `step` takes one step. A message on
    `initialpose` puts the car there, at rest, in place of the next step.

    Attributes
    ----------
    finished
        Done when the last lap's state at or beyond `distance` is published and answered, or by
        `finish`.
    inputs
        The topics that it subscribes to, with their types.

    Examples
    --------
    >>> import rclpy
    >>> from barc_sim.nodes.controller import CruiseController
    >>> from barc_sim.ros.executor import QuickExecutor
    >>> rclpy.init()
    >>> lock_step = [rclpy.Parameter('realtime_factor', value=0.0)]
    >>> simulator = VehicleSimulator(distance=50.0, parameter_overrides=lock_step)
    >>> executor, nodes = QuickExecutor(), (CruiseController(), simulator)
    >>> all(executor.add_node(node) for node in nodes)
    True
    >>> executor.spin_until_future_complete(simulator.finished)
    >>> simulator.states, simulator.missed
    (339, 0)
    >>> executor.shutdown()
    True
    >>> for node in nodes:
    ...     node.destroy_node()
    >>> rclpy.shutdown()
    """

    inputs: ClassVar[dict[str, type[Any]]] = {
        names.ECU: ECU,
        names.INITIAL_POSE: PoseWithCovarianceStamped,
    }

    def __init__(
        self,
        *,
        road: Road | None = None,
        distance: float = 0.0,
        keeps_clock: bool = True,
        on_step: Callable[[float, Observation], None] | None = None,
        model: Model = bikeFE,
        check_period: float = CHECK_PERIOD,
        **options: Any,  # noqa: ANN401 (Node's own)
    ) -> None:
        """Declare the parameters, claim the topic, and wait for a controller.

        `road` replaces the one that the parameter `road` names. `distance` [m] is the parameter's
        default. Of several cars in a domain only one `keeps_clock`. `on_step` is called with the
        simulated time [s] and what is published; it must be quick. `model` steps the car. Peers are
        checked every `check_period` [s].

        Raises
        ------
        UserError
            if a parameter is out of range, or the topic has a simulator already.
        """
        super().__init__('vehicle_simulator', **options)
        values = declare(self, parameters(distance))
        self._set_up(values, road, model, on_step)
        self.add_post_set_parameters_callback(self._on_parameters)
        self._claim = claim(self, names.STATE)
        self.finished: Future = Future()
        self._refused = RefusedInput(self)

        self._state_publishers = StatePublishers(
            partial(FieldPublisher, self), clock=keeps_clock and publishes_clock(values)
        )
        self._read_command = field_reader(ECU, 'motor', 'servo')
        self._may_keep_clock = keeps_clock
        self._peers = PeerWatch(self, self._state_publishers)
        group = QuickCallbackGroup()
        self._drain = drained_subscription(self, ECU, names.ECU, self._on_command, group)
        subscription(
            self,
            PoseWithCovarianceStamped,
            names.INITIAL_POSE,
            self._on_initial_pose,
            group,
            qos=names.QOS_NEWEST,
        )
        for kind, name, callback in (
            (Trigger, names.RESET_SIMULATOR, self._on_reset),
            (SetBool, names.PAUSE_SIMULATOR, self._on_pause),
            (Trigger, names.STEP_SIMULATOR, self._on_single_step),
        ):
            self.create_service(kind, name, callback, callback_group=group)
        wall = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(check_period, self._check_peers, group, wall)
        if period := self._stepper.deadline_period:
            self._deadlines = self.create_timer(period, self._stepper.pass_deadline, group, wall)
            self._deadlines.cancel()
        self._gate = StartGate(self, group, wall, self._begin, wait=values['wait_for_controller'])

    def destroy_node(self) -> None:
        """Release the topic, and destroy the node."""
        self._claim.close()
        super().destroy_node()

    @property
    def refused(self) -> int:
        """Messages that were not finite or out of range, and commands that came out of order."""
        return self._refused.count

    # What the stepper calls, beside the methods of `Simulator`.

    def deliver_commands(self) -> None:
        """Take the commands that wait in the subscription, before its callback is due."""
        self._drain()

    def prepare_start(self, why: str) -> None:
        """Reset the nodes that command, and begin after that."""
        self._gate.close()
        self.get_logger().info(why)

    def finish(self) -> None:
        """End the run; may be called from any thread."""
        self.finished.set_result(None)

    def warn_missed(self, state: int, missed: int) -> None:
        """Warn of a missed deadline, once a second at most."""
        self.get_logger().warning(missed_deadline(state, missed), throttle_duration_sec=1.0)

    def warn_timeout(self, timeout: float) -> None:
        """Warn that commands are lost, every ten seconds at most."""
        self.get_logger().warning(commands_lost(timeout), throttle_duration_sec=10.0)

    def warn_behind(self, behind: float) -> None:
        """Warn that stamps are behind the wall clock, and publish `/clock` from now on."""
        if self._may_keep_clock:
            self._state_publishers.begin_clock()
        self.get_logger().warning(stamps_behind(behind, clock=self._may_keep_clock))

    # What calls the stepper.

    def _begin(self) -> None:
        if len(living_publishers(self, names.STATE)) > 1:
            topic = self.resolve_topic_name(names.STATE)
            raise UserError(taken(topic, self.context.get_domain_id()))
        self._stepper.start()

    def _on_command(self, data: bytes) -> None:
        stamp = leading_time(data)
        why = self._stepper.refusal(stamp) or self._stepper.take_command(
            Command(*self._read_command(data)), stamp
        )
        if why:
            self._refused.add(lambda: why)

    def _on_parameters(self, changed: list[RosParameter]) -> None:
        self._change({parameter.name: parameter.value for parameter in changed})

    def _on_initial_pose(self, message: PoseWithCovarianceStamped) -> None:
        place = to_state_at_rest(message.pose.pose)
        if place is None:
            self._refused.add(
                lambda: f'an initial pose that is not finite or no rotation: {message.pose.pose}'
            )
        else:
            self._stepper.place(place)

    def _on_reset(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        self._stepper.reset()
        response.success, response.message = True, 'the car is back at the start'
        return response

    def _on_pause(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        changed = self._stepper.pause(on=bool(request.data))
        response.success, response.message = True, 'paused' if request.data else 'running'
        if changed:
            self.get_logger().info(response.message)
        return response

    def _on_single_step(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        response.success, response.message = self._stepper.single_step()
        return response

    def _check_peers(self) -> None:
        self._stepper.check()
        self._peers.check(self.states, waits=not (self._deadlines or self.paused))
