"""The node `vehicle_simulator`: owns time, and steps the plant with the commands it is sent."""

from __future__ import annotations

import sys
import time
from math import inf, isfinite
from typing import TYPE_CHECKING, Any

from barc_interfaces.msg import ECU, Environment, EZDynBkMdl, ZDynBkMdl
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.task import Future
from std_srvs.srv import SetBool, Trigger

from barc_sim import service_names, topic_names
from barc_sim.claim import claim, taken
from barc_sim.cli import call
from barc_sim.commands import Commands
from barc_sim.convert import (
    to_environment,
    to_header,
    to_input,
    to_nanoseconds,
    to_state,
    to_state_error,
)
from barc_sim.endpoints import incompatible_peers, publisher, subscription
from barc_sim.errors import UserError
from barc_sim.executor import QuickCallbackGroup
from barc_sim.parameters import Parameter, declare
from barc_sim.process import spin
from barc_sim.simulator_parameters import PARAMETERS, period_ns, plant

if TYPE_CHECKING:
    from collections.abc import Callable

    from rclpy.timer import Timer

    from barc_sim.plant import Observation

_DISTANCE = Parameter(
    'distance', 0.0, 'the run ends here [m]; 0: it goes on', (0.0, 1e6), read_only=True
)
#: [s]
_GATE_PERIOD = 0.01
#: Periods from seeing a controller to the first state. The controller sees this node a little
#: sooner or later than it is seen; a message that it is sent or sends meanwhile would be lost.
_GATE_COUNT = 10
_CHECK_PERIOD = 1.0
#: Share of a period by which a deadline that is judged may be late.
_PUNCTUAL = 0.1
#: So long a node that commands is waited for to reset itself.
_RESET_TIMEOUT = 0.5


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

    Its service `reset` starts afresh, once the present state is answered: state, held command and
    noise are as at first, the nodes that command are reset, too, and stamps go on. Its service
    `pause` lets simulated time stand still.

    Attributes
    ----------
    finished
        Done when a state at or beyond `distance` has been published and answered, or by `finish`.
    steps
        States published.
    missed
        Commands that were not there when they were due.
    slipped
        Periods by which simulated time has fallen behind the wall clock.
    """

    def __init__(
        self,
        *,
        distance: float = 0.0,
        on_step: Callable[[float, Observation], None] | None = None,
        **options: Any,  # noqa: ANN401 (Node's own)
    ) -> None:
        """Declare the parameters, claim the topic, and wait for a controller.

        `distance` [m] is the parameter's default. `on_step` is told the simulated time [s] and
        what was published; it must be quick.

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
        self._realtime_factor = values['realtime_factor']
        self._wait_for_controller = values['wait_for_controller']
        self._plant = plant(values)
        self._commands = Commands(values['command_timeout'])
        self._on_step = on_step
        self._claim = claim(self, topic_names.STATE)
        self.finished: Future = Future()
        self.steps = self.missed = self.slipped = 0
        self._first_step = self._stamp = 0
        self._running = self._paused = self._reset_due = False
        self._pace: Timer | None = None

        self._state_error_pub = publisher(self, EZDynBkMdl, topic_names.STATE_ERROR)
        self._environment_pub = publisher(self, Environment, topic_names.ENVIRONMENT)
        self._state_pub = publisher(self, ZDynBkMdl, topic_names.STATE)
        self._group = QuickCallbackGroup()
        subscription(self, ECU, topic_names.ECU, self._on_command, self._group)
        self.create_service(
            Trigger, service_names.RESET, self._on_reset, callback_group=self._group
        )
        self.create_service(
            SetBool, service_names.PAUSE, self._on_pause, callback_group=self._group
        )
        self._resets = [
            self.create_client(Trigger, name, callback_group=self._group)
            for name in (service_names.RESET_CONTROLLER, service_names.RESET_RELAY)
        ]
        self._resetting: list[Future] = []
        self._wall = Clock(clock_type=ClockType.STEADY_TIME)
        self._warned: set[str] = set()
        self._timer(_CHECK_PERIOD, self._check_peers)
        self._gate = self._timer(_GATE_PERIOD, self._wait)
        self._ready_for = 0
        self._steps_checked = 0

    def destroy_node(self) -> None:
        """Give up the topic, and destroy the node."""
        self._claim.close()
        super().destroy_node()

    @property
    def paused(self) -> bool:
        """Whether time stands still because somebody asked for it."""
        return self._paused

    def finish(self) -> None:
        """End the run; may be called from any thread."""
        self.finished.set_result(None)

    def _timer(self, period: float, callback: Callable[[], None]) -> Timer:
        return self.create_timer(period, callback, self._group, self._wall)

    def _wait(self) -> None:
        """Begin once there is a controller, and reset where it was asked to be."""
        if not all(future.done() for future in self._resetting):
            if time.monotonic() < self._reset_until:
                return
            self.get_logger().warning('a node that commands has not answered its reset')
        ready = self.count_publishers(topic_names.ECU) or not self._wait_for_controller
        self._ready_for = self._ready_for + 1 if ready else 0
        if self._ready_for >= _GATE_COUNT:
            self._gate.cancel()
            self._begin()

    def _begin(self) -> None:
        if self.count_publishers(topic_names.STATE) > 1:
            raise UserError(taken(self._state_pub.topic_name, self.context.get_domain_id()))
        self._running = True
        self._stamp = max(time.time_ns(), self._stamp + self._period_ns)
        self._commands.wait(time.monotonic())
        self._publish_state()
        self._go_on()

    def _go_on(self) -> None:
        """Let time run from now on."""
        if self._paused or not self._realtime_factor:
            return
        period = self._plant.ts / self._realtime_factor
        self._due = time.monotonic() + period
        if self._pace:
            self._pace.reset()
        else:
            self._pace = self._timer(period, self._on_deadline)

    def _hold(self) -> None:
        """Let time stand still."""
        if self._pace:
            self._pace.cancel()

    def _publish_state(self) -> None:
        seen = self._plant.observe()
        header = to_header(self._stamp)
        self._environment_pub.publish(to_environment(seen, header))
        self._state_error_pub.publish(to_state_error(seen, header))
        self._state_pub.publish(to_state(seen, header))
        if self._on_step:
            self._on_step((self.steps - self._first_step) * self._plant.ts, seen)
        self.steps += 1

    def _on_command(self, message: ECU) -> None:
        if not (isfinite(message.motor) and isfinite(message.servo)):
            self.get_logger().warning(
                f'refused a command that is not finite: {message.motor}, {message.servo}',
                throttle_duration_sec=1.0,
            )
            return
        stamp = to_nanoseconds(message.header.stamp)
        self._commands.hear(to_input(message), stamp, self._stamp, time.monotonic())
        if self._running and self._commands.answered:
            if self._reset_due:
                self._reset()
            elif not (self._realtime_factor or self._paused):
                self._advance()

    def _on_reset(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        self._reset_due = True
        if self._commands.answered or not self._running:
            self._reset()
        response.success, response.message = True, 'the car is back at the start'
        return response

    def _reset(self) -> None:
        self._reset_due = self._running = False
        self._hold()
        self._plant = plant(self._values)
        self._commands = Commands(self._values['command_timeout'])
        self._first_step = self.steps
        ready = [reset for reset in self._resets if reset.service_is_ready()]
        self._resetting = [reset.call_async(Trigger.Request()) for reset in ready]
        self._reset_until = time.monotonic() + _RESET_TIMEOUT
        self._ready_for = min(self._ready_for, _GATE_COUNT - 1)  # they know one another
        self._gate.reset()

    def _on_pause(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        was, self._paused = self._paused, bool(request.data)
        response.success, response.message = True, 'paused' if self._paused else 'running'
        if self._paused:
            self._hold()
        elif was and self._running:
            if self._commands.answered and not self._realtime_factor:
                self._advance()
            self._go_on()
        return response

    def _on_deadline(self) -> None:
        period = self._plant.ts / self._realtime_factor
        late = max(time.monotonic() - self._due, 0.0)
        behind = int(late / period)
        self._due += (behind + 1) * period
        self.slipped += behind
        if not self._commands.answered and late > _PUNCTUAL * period:
            # The machine held up the whole process, maybe the controller in it, too: the state
            # gets another period to be answered in.
            self.slipped += 1
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
        if self._reset_due:
            self._reset()
            return
        if self._plant.state.x >= self._distance:
            self._hold()
            self.finish()
            return
        if self._commands.lost(time.monotonic()):
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
        """Say once what keeps this node from hearing or being heard."""
        if self._reset_due:  # nobody answers the present state
            self._reset()
        if not self.steps:
            self._warn(f'waiting for a controller that publishes {self.resolve_topic_name("ecu")}')
        elif not (self._realtime_factor or self._paused) and self.steps == self._steps_checked:
            self._warn(f'waiting for the command that answers state {self.steps - 1}')
        self._steps_checked = self.steps
        for sentence in incompatible_peers(self):
            self._warn(sentence)

    def _warn(self, sentence: str) -> None:
        if sentence not in self._warned:
            self._warned.add(sentence)
            self.get_logger().warning(sentence)


def main(args: list[str] | None = None) -> int:
    """Run the node alone, until it finishes or is told to stop."""
    return call('vehicle_simulator', lambda: spin(VehicleSimulator, args))


if __name__ == '__main__':
    sys.exit(main())
