"""The node `vehicle_simulator`: owns time, and steps the car with the commands that it receives."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from barc_interfaces.msg import ECU, AppliedCommand, Environment, EZDynBkMdl, TrackState, ZDynBkMdl
from builtin_interfaces.msg import Time
from geometry_msgs.msg import PoseWithCovarianceStamped
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.task import Future
from rosgraph_msgs.msg import Clock as ClockMessage
from std_msgs.msg import Header
from std_srvs.srv import SetBool, Trigger

from barc_sim.interfaces import qos, services, topics
from barc_sim.interfaces.records import Command
from barc_sim.interfaces.stamps import split_time, to_nanoseconds
from barc_sim.nodes.start_gate import PeerWatch, StartGate
from barc_sim.ros.conversions import fill, frames
from barc_sim.ros.outputs import Subscribed
from barc_sim.ros.parameters import declare, declare_track
from barc_sim.ros.peers import claim
from barc_sim.ros.poses import to_state_at_rest
from barc_sim.ros.refused_input import RefusedInput
from barc_sim.simulation.scenario import Scenario
from barc_sim.simulation.stepper import Stepper, StepperOptions, parameters
from barc_sim.vehicle.bike_model import bikeFE
from barc_sim.vehicle.road import Road

if TYPE_CHECKING:
    from collections.abc import Callable

    from rclpy.parameter import Parameter
    from rclpy.publisher import Publisher
    from rclpy.timer import Timer

    from barc_sim.vehicle.bike_model import Model
    from barc_sim.vehicle.plant import Observation
    from barc_sim.vehicle.track import Track


class VehicleSimulator(Node):
    """Publishes the state, and steps it with the command that answers it.

    `stepper` has the rules, and counts `states`, `missed` deadlines and `slipped` periods. State
    `k` is stamped `t_0 + k·T_s`.

    Each state's stamp is published on `/clock` before the state, and again every second while time
    stands still. At factor 1 this needs the parameter `clock` to be true.

    The service `reset` resets the car, and the controller or relay, once the present state is
    answered. `pause` stops and resumes time; `step` takes one step while time is paused. A pose on
    `initialpose` resets the car, too, to that pose. `finished` is done at the end of the run;
    `refused` counts invalid messages.

    Examples
    --------
    >>> import rclpy
    >>> from rclpy.executors import MultiThreadedExecutor
    >>> from barc_sim.nodes.controller import CruiseController
    >>> rclpy.init()
    >>> lock_step = [rclpy.Parameter('realtime_factor', value=0.0)]
    >>> simulator = VehicleSimulator(distance=50.0, parameter_overrides=lock_step)
    >>> with MultiThreadedExecutor() as executor:
    ...     _ = [executor.add_node(node) for node in (CruiseController(), simulator)]
    ...     executor.spin_until_future_complete(simulator.finished)
    >>> simulator.stepper.states, simulator.stepper.missed
    (339, 0)
    >>> simulator.destroy_node()
    >>> rclpy.shutdown()
    """

    def __init__(
        self,
        *,
        road: Road | None = None,
        track: Track | None = None,
        distance: float = 0.0,
        keeps_clock: bool = True,
        on_step: Callable[[float, Observation], None] | None = None,
        model: Model = bikeFE,
        check_period: float = 1.0,
        **options: Any,  # noqa: ANN401 (Node's own)
    ) -> None:
        """Claim the topic of the state, and wait for a controller.

        `road` and `track` replace those that the parameters name; `distance` [m] is the default of
        its parameter. In a domain with several cars only one `keeps_clock`. `on_step` is called
        with the simulated time [s] and the published observation; it must return quickly. `model`
        steps the car. Peers are checked every `check_period` [s].

        UserError: a parameter is out of range, or another simulator publishes the state.
        """
        super().__init__('vehicle_simulator', **options)

        self.track = declare_track(self, track)
        self.values = declare(self, parameters(distance, on_track=bool(self.track)))
        self.road = road or Road.named(self.values['road'])

        self._model = model
        pace = StepperOptions(**{name: self.values[name] for name in StepperOptions._fields})
        self.stepper = Stepper(self._scenario(), pace, self)
        self.add_post_set_parameters_callback(self._on_parameters)
        self.on_step = on_step
        self.finished = Future()
        self.refused = RefusedInput(self)
        self._claim = claim(self, topics.STATE)

        self._make_messages()
        has_clock = keeps_clock and (pace.clock or pace.realtime_factor != 1.0)
        self._create_publishers(has_clock=has_clock)

        self.create_subscription(ECU, topics.ECU, self._on_command, qos.DEFAULT)
        self.create_subscription(
            PoseWithCovarianceStamped, topics.INITIAL_POSE, self._on_initial_pose, qos.NEWEST
        )

        self.create_service(Trigger, services.RESET_SIMULATOR, self._on_reset)
        self.create_service(SetBool, services.PAUSE_SIMULATOR, self._on_pause)
        self.create_service(Trigger, services.STEP_SIMULATOR, self._on_single_step)

        wall = Clock(clock_type=ClockType.STEADY_TIME)
        self._deadlines: Timer | None = None
        if self.stepper.deadline_period:
            self._deadlines = self.create_timer(
                self.stepper.deadline_period, self.stepper.pass_deadline, clock=wall
            )
        self.run_deadlines(on=False)
        self._deferred = self.create_guard_condition(self.stepper.decide)

        self.peers = PeerWatch(self, self.stepper, self._publish_state, self._publish_clock)
        self.create_timer(check_period, self.peers.check, clock=wall)
        self._gate = StartGate(self, wall, self.stepper.start, wait=pace.wait_for_controller)

    def _make_messages(self) -> None:
        """Make each message once: new ones for each state would cost time.

        All share the stamp `_stamp`, which is that of the latest state: only `publish_state`
        changes it. What is published until the next state has this stamp, too.
        """
        map_frame, car_frame = frames(self)
        self._stamp = Time()
        on_map = Header(stamp=self._stamp, frame_id=map_frame)
        on_car = Header(stamp=self._stamp, frame_id=car_frame)

        self._time = ClockMessage(clock=self._stamp)
        self._state = ZDynBkMdl(header=on_map)
        self._error = EZDynBkMdl(header=on_car)
        self._place = TrackState(header=on_map)
        self._applied = AppliedCommand(header=on_car)
        self._environment = Environment(header=on_map)

    def _create_publishers(self, *, has_clock: bool) -> None:
        """Create the publishers; `/clock` and the place on a track have one only if asked for."""
        self.clock_pub: Publisher | None = None
        if has_clock:
            self.clock_pub = self.create_publisher(ClockMessage, topics.CLOCK, qos.DEFAULT)
        self._track_pub: Publisher | None = None
        if self.track:
            self._track_pub = self.create_publisher(TrackState, topics.TRACK_STATE, qos.DEFAULT)
        self._error_pub = self.create_publisher(EZDynBkMdl, topics.STATE_ERROR, qos.DEFAULT)
        self._applied_pub = self.create_publisher(
            AppliedCommand, topics.APPLIED_COMMAND, qos.DEFAULT
        )
        self._environment_pub = self.create_publisher(Environment, topics.ENVIRONMENT, qos.DEFAULT)
        self._state_pub = self.create_publisher(ZDynBkMdl, topics.STATE, qos.DEFAULT)
        self._subscribed = Subscribed(self)

    def destroy_node(self) -> None:
        """Release the topic, and destroy the node."""
        self._claim.close()
        super().destroy_node()

    def publish_state(self, t: float, seen: Observation, stamp_ns: int) -> None:
        """Publish the observation at `t` [s], stamped `stamp_ns` [ns]; `z_vhcl` comes last."""
        self._seen = seen
        self._stamp.sec, self._stamp.nanosec = split_time(stamp_ns)

        subscribed = self._subscribed.at(stamp_ns)
        if self.clock_pub in subscribed:
            self._publish_clock()
        if self._environment_pub in subscribed:
            self._environment_pub.publish(fill(self._environment, seen.surroundings))
        self._publish_state(with_error=self._error_pub in subscribed)
        if self.on_step:
            self.on_step(t, seen)

    def publish_applied(self, command: Command, stamp_ns: int, *, missed: bool) -> None:
        """Publish the command that is applied from the latest state on.

        The message shares the stamp of this state, `stamp_ns` [ns], with all others.
        """
        if self._applied_pub in self._subscribed.at(stamp_ns):
            self._applied.motor = float(command.motor)
            self._applied.servo = float(command.servo)
            self._applied.missed = missed
            self._applied_pub.publish(self._applied)

    def run_deadlines(self, *, on: bool) -> None:
        """Call `Stepper.pass_deadline` every period from now on, or no longer."""
        if self._deadlines:
            if on:
                self._deadlines.reset()
            else:
                self._deadlines.cancel()

    def defer_decision(self) -> None:
        """Call `Stepper.decide` after the commands that have arrived are delivered."""
        self._deferred.trigger()

    def prepare_start(self, reason: str) -> None:
        """Log `reason`, reset the nodes that command, and start after that."""
        self._gate.restart()
        self.get_logger().info(reason)

    def finish(self) -> None:
        """End the run; may be called from any thread."""
        self.finished.set_result(None)

    def warn(self, sentence: Callable[[], str], about: str) -> None:
        """Log what `sentence` returns, at most once in 10 s for what it is `about`."""
        self.refused.warn(sentence, about, period=10.0)

    def _publish_clock(self) -> None:
        if self.clock_pub:
            self.clock_pub.publish(self._time)

    def _publish_state(self, *, with_error: bool = True) -> None:
        if with_error:
            self._error_pub.publish(fill(self._error, self._seen.error))
        if self._track_pub:
            self._track_pub.publish(fill(self._place, self._seen.on_track))
        self._state_pub.publish(fill(self._state, self._seen.measured))

    def _on_command(self, command: ECU) -> None:
        stamp = to_nanoseconds(command.header.stamp)
        why = self.stepper.take_command(Command(command.motor, command.servo), stamp)
        if why:
            self.refused.add(lambda: why)

    def _on_initial_pose(self, message: PoseWithCovarianceStamped) -> None:
        map_frame, base_link = frames(self)
        odom = base_link.replace('base_link', 'odom')
        frame = message.header.frame_id
        if frame not in ('', map_frame, odom):
            why = f'an initial pose in the frame {frame!r}: expected {map_frame!r} or {odom!r}'
            self.refused.add(lambda: why)
            return

        road = Road.flat() if self.track else self.road  # as the mirror shows it
        refusal = self.stepper.place(to_state_at_rest(message.pose.pose, road))
        if refusal:
            self.refused.add(lambda: refusal)

    def _on_parameters(self, changed: list[Parameter]) -> None:
        self.values = self.values | {parameter.name: parameter.value for parameter in changed}
        self.stepper.retune(self._scenario())

    def _scenario(self) -> Scenario:
        """Return the record of the present parameters."""
        return Scenario.of_parameters(
            self.values, road=self.road, track=self.track, model=self._model
        )

    def _on_reset(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        response.success = True
        if self.stepper.reset():
            response.message = 'the car is back at the start'
        else:
            state = self.stepper.states - 1
            response.message = f'the car goes back when state {state} is answered, or after 1 s'
        return response

    def _on_pause(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        response.success = True
        response.message = 'paused' if request.data else 'running'
        if self.stepper.pause(on=request.data):
            self.get_logger().info(response.message)
        return response

    def _on_single_step(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        response.success, response.message = self.stepper.single_step()
        return response
