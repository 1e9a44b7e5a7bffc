"""The node `vehicle_simulator`: owns time, and steps the plant with the commands it is sent."""

from __future__ import annotations

import sys
import time
from math import inf
from typing import TYPE_CHECKING, Any

from barc_interfaces.msg import ECU
from geometry_msgs.msg import PoseWithCovarianceStamped
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.serialization import deserialize_message
from rclpy.task import Future
from std_srvs.srv import SetBool, Trigger

from barc_sim.cli.parser import call
from barc_sim.errors import UserError
from barc_sim.nodes.simulator.commands import Commands
from barc_sim.nodes.simulator.pacing import Pace
from barc_sim.nodes.simulator.peer_watch import PeerWatch
from barc_sim.nodes.simulator.publishers import StateOutlet
from barc_sim.nodes.simulator.start_gate import Gate
from barc_sim.ros import names
from barc_sim.ros.conversions import NANOSECONDS, leading_time, to_input, to_state_at_rest
from barc_sim.ros.endpoints import drained_subscription, subscription
from barc_sim.ros.executor.executor import QuickCallbackGroup
from barc_sim.ros.parameters import declare
from barc_sim.ros.peers import claim, living_publishers, taken
from barc_sim.ros.process import spin
from barc_sim.ros.warnings import RefusedInput
from barc_sim.vehicle.bike_model import Input, bikeFE
from barc_sim.vehicle.parameter import Parameter
from barc_sim.vehicle.parameters import PARAMETERS
from barc_sim.vehicle.plant_values import period_ns, plant

if TYPE_CHECKING:
    from collections.abc import Callable

    from barc_sim.vehicle.bike_model import Model, State
    from barc_sim.vehicle.plant import Observation

_DISTANCE = Parameter(
    'distance', 0.0, 'the run ends here [m]; 0: it goes on', (0.0, 1e6), read_only=True
)
#: [s] between two looks at who is there.
_CHECK_PERIOD = 1.0


class VehicleSimulator(Node):
    """Publishes the state, and steps it with the command that answers it.

    State `k` is stamped `t_0 + k·T_s`. With a real-time factor the command for state `k` is due
    when state `k + 1` is; where it has not arrived, the last one holds, and `missed` counts it.
    Where the simulator itself is late, simulated time stands still for whole periods, and
    `slipped` counts them. Without (`realtime_factor` 0) each step is taken as soon as its
    command has arrived.

    A command answers the state whose stamp it bears. One without a stamp, as `ros2 topic pub`
    sends it, holds until the next, and nothing is missed meanwhile. Where none has arrived for
    `command_timeout` by the wall clock, the car brakes to a standstill and stays there.

    Where `realtime_factor` is not 1, and with the parameter `clock` at 1, too, each state's stamp
    is published on `/clock` before the state is, for nodes that `use_sim_time`; while time stands
    still, again every second.

    Its service `reset` starts afresh, once the present state is answered: state, held command and
    noise are as at first, the nodes that command are reset, too, and stamps go on. Its service
    `pause` lets simulated time stand still, and `step` lets it go on by one step meanwhile. An
    `initialpose` puts the car there, at rest, in place of the next step.

    Attributes
    ----------
    finished
        Done when a state at or beyond `distance` has been published and answered, or by `finish`.
    steps
        States published.
    missed
        Commands that were not there when they were due.
    """

    def __init__(
        self,
        *,
        distance: float = 0.0,
        keeps_clock: bool = True,
        on_step: Callable[[float, Observation], None] | None = None,
        model: Model = bikeFE,
        **options: Any,  # noqa: ANN401 (Node's own)
    ) -> None:
        """Declare the parameters, claim the topic, and wait for a controller.

        `distance` [m] is the parameter's default. Of several cars in a domain only one
        `keeps_clock`. `on_step` is told the simulated time [s] and
        what was published; it must be quick. `model` steps the car.

        Raises
        ------
        UserError
            where a parameter is out of range, or the topic has a simulator already.
        """
        super().__init__('vehicle_simulator', **options)
        table = [parameter._replace(read_only=True) for parameter in PARAMETERS]
        values = declare(self, [*table, _DISTANCE._replace(default=distance)])
        self._values = values
        self._period_ns = period_ns(values)
        self._distance = values['distance'] or inf
        self._model = model
        self._plant = plant(values, model)
        self._commands = Commands(values['command_timeout'])
        self._greatest = Input(values['refuse_motor_above'], values['refuse_servo_above'])
        factor = values['realtime_factor']
        self._pace = Pace(self._plant.ts / factor) if factor else None
        self._on_step = on_step
        self._claim = claim(self, names.STATE)
        self.finished: Future = Future()
        self.steps = self.missed = 0
        self._refusals = RefusedInput(self)
        self._first_step = self._stamp = 0
        self._running = self._paused = self._reset_due = self._step_due = False
        self._place: State | None = None  # to be put there

        clock = keeps_clock and (bool(values['clock']) or factor != 1.0)
        self._outlet = StateOutlet(self, clock=clock)
        self._watch = PeerWatch(self, self._outlet)
        group = QuickCallbackGroup()
        self._hear = drained_subscription(self, ECU, names.ECU, self._on_command, group)
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
        self.create_timer(_CHECK_PERIOD, self._check_peers, group, wall)
        self._deadline = None
        if self._pace:
            self._deadline = self.create_timer(self._pace.period, self._on_deadline, group, wall)
            self._deadline.cancel()
        self._gate = Gate(self, group, wall, self._begin, wait=values['wait_for_controller'])

    def destroy_node(self) -> None:
        """Give up the topic, and destroy the node."""
        self._claim.close()
        super().destroy_node()

    @property
    def keeps_clock(self) -> bool:
        """Whether it publishes `/clock`."""
        return self._outlet.keeps_clock

    @property
    def paused(self) -> bool:
        """Whether time stands still because somebody asked for it."""
        return self._paused

    @property
    def slipped(self) -> int:
        """Periods by which simulated time has fallen behind the wall clock."""
        return self._pace.slipped if self._pace else 0

    @property
    def refused(self) -> int:
        """Messages that were not finite or out of range, and commands that came out of order."""
        return self._refusals.count

    def finish(self) -> None:
        """End the run; may be called from any thread."""
        self.finished.set_result(None)

    def _begin(self) -> None:
        if len(living_publishers(self, names.STATE)) > 1:
            raise UserError(taken(self._outlet.topic, self.context.get_domain_id()))
        self._running = True
        self._stamp = max(time.time_ns(), self._stamp + self._period_ns)
        self._commands.wait(time.monotonic())
        self._publish_state()
        self._go_on()

    def _go_on(self) -> None:
        """Let time run from now on."""
        if self._pace and self._deadline and not self._paused:
            self._pace.begin(time.monotonic())
            self._deadline.reset()

    def _hold(self) -> None:
        """Let time stand still."""
        if self._deadline:
            self._deadline.cancel()

    def _publish_state(self) -> None:
        seen = self._plant.observe()
        self._outlet.publish(seen, self._stamp)
        if self._on_step:
            self._on_step((self.steps - self._first_step) * self._plant.ts, seen)
        self.steps += 1

    def _on_command(self, data: bytes) -> None:
        stamp = leading_time(data)
        if not self._commands.usable(stamp, self._stamp):
            away = (stamp - self._stamp) / NANOSECONDS
            self._refusals.add(
                lambda: (
                    f'a command stamped {away:+g} s from the present state: a newer one or '
                    'its answer holds'
                )
            )
            return
        command, limits = to_input(deserialize_message(data, ECU)), self._greatest
        # Written so that NaN is out of range, too.
        if not (abs(command.motor) <= limits.motor and abs(command.servo) <= limits.servo):
            self._refusals.add(
                lambda: (
                    f'a command beyond ±{limits.motor:g} m/s² or ±{limits.servo:g} rad: '
                    f'{command.motor}, {command.servo}'
                )
            )
            return
        self._commands.hear(command, stamp, self._stamp, time.monotonic())
        if self._running and self._commands.answered:
            if self._reset_due:
                self._reset()
            elif self._step_due or not (self._pace or self._paused):
                self._advance()

    def _on_initial_pose(self, message: PoseWithCovarianceStamped) -> None:
        place = to_state_at_rest(message.pose.pose)
        if place is None:
            self._refusals.add(
                lambda: f'an initial pose that is not finite, or not one: {message.pose.pose}'
            )
            return
        self._place = place
        if self._paused and self._running:
            self._step_due = True
            self._advance_if_answered()

    def _on_reset(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        self._reset_due = True
        if self._commands.answered or not self._running:
            self._reset()
        response.success, response.message = True, 'the car is back at the start'
        return response

    def _reset(self) -> None:
        self._reset_due = self._step_due = self._running = False
        self._place = None
        self._hold()
        self._plant = plant(self._values, self._model)
        self._commands = Commands(self._values['command_timeout'])
        self._first_step = self.steps
        self._gate.close()
        self.get_logger().info('reset: the car is back at the start')

    def _on_pause(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        was, self._paused = self._paused, bool(request.data)
        response.success, response.message = True, 'paused' if self._paused else 'running'
        if was != self._paused:
            self.get_logger().info(response.message)
        if self._paused:
            self._hold()
        elif was and self._running:
            self._step_due = False
            if not self._pace:
                self._advance_if_answered()
            self._go_on()
        return response

    def _on_single_step(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        response.success = self._paused and self._running
        if response.success:
            self._step_due = True
            self._advance_if_answered()
            response.message = (
                f'state {self.steps - 1} is not answered yet: the step follows'
                if self._step_due
                else f'state {self.steps - 1}'
            )
        else:
            response.message = 'time runs: pause it first' if self._running else 'not begun yet'
        return response

    def _advance_if_answered(self) -> None:
        if self._commands.answered:
            self._advance()

    def _on_deadline(self) -> None:
        assert self._pace  # noqa: S101 (its timer runs)
        punctual = self._pace.pass_deadline(time.monotonic())
        if not self._commands.answered:
            self._hear()  # it may be there, but not in the order in which callbacks come
            if not self._running:  # a reset was due, and is done
                return
        if not (self._commands.answered or punctual):
            # The machine held up the whole process, maybe the controller in it, too: the state
            # gets another period to be answered in.
            self._pace.slipped += 1
            return
        if not self._commands.answered:
            self.missed += 1
            self.get_logger().warning(
                f'missed deadline {self.missed}: no command answers state {self.steps - 1} '
                'in time; the last one holds',
                throttle_duration_sec=1.0,
            )
        self._advance()

    def _advance(self) -> None:
        """Take the step to the next state, or finish where the present one is the last."""
        self._step_due = False
        if self._reset_due:
            self._reset()
            return
        if self._plant.state.x >= self._distance and not self._place:
            self._hold()
            self.finish()
            return
        if self._place:
            self._plant.place(self._place)
            self._place = None
        elif self._commands.lost(time.monotonic()):
            self.get_logger().warning(
                f'no command for {self._commands.timeout:g} s: the car brakes to a standstill',
                throttle_duration_sec=10.0,
            )
            self._plant.brake(self._values['timeout_braking'])
        else:
            self._plant.advance(self._commands.latest)
        self._commands.expect()
        self._stamp += self._period_ns
        self._publish_state()

    def _check_peers(self) -> None:
        if self._reset_due:  # nobody answers the present state
            self._reset()
        self._watch.look(self.steps, waits=not (self._pace or self._paused))


def main(args: list[str] | None = None) -> int:
    """Run the node alone, until it finishes or is told to stop."""
    return call('vehicle_simulator', lambda: spin(VehicleSimulator, args))


if __name__ == '__main__':
    sys.exit(main())
