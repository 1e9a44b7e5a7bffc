"""The simulator and the controller of a run without ROS: they call what their nodes in ROS call."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any

from barc_sim.control.cruise_control import CruiseControl
from barc_sim.simulation.publishers import AnswerPublishers, StatePublishers
from barc_sim.simulation.simulator import (
    CHECK_PERIOD,
    Simulator,
    commands_lost,
    missed_deadline,
    parameters,
    publishes_clock,
    stamps_behind,
)
from barc_sim.simulation.stepper import Phase

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from barc_sim.control.controller import Controller
    from barc_sim.runs.local.host import LocalHost
    from barc_sim.vehicle.bike_model import Command, Model
    from barc_sim.vehicle.plant import Observation
    from barc_sim.vehicle.road import Road


class LocalSimulator(Simulator):
    """Steps the car, and passes each state to who commands it.

    Attributes
    ----------
    finished
        Whether the run is at its end.
    on_state
        Called with stamp [ns] and observation of each state; what it returns answers the state.
    on_reset
        Called before time starts anew.
    """

    def __init__(
        self,
        host: LocalHost,
        *,
        road: Road | None,
        on_step: Callable[[float, Observation], None],
        model: Model,
        given: Mapping[str, Any],
        distance: float = 0.0,
    ) -> None:
        """Declare the parameters; those that are `given` override the defaults.

        Raises
        ------
        UserError
            if a parameter is out of range.
        """
        self._host = host
        self._node = node = host.node('vehicle_simulator')
        values = node.declare(parameters(distance), given)
        self._set_up(values, road, model, on_step)
        self.finished = False
        self.on_state: Callable[[int, Observation], Command | None] = lambda *_: None
        self.on_reset: Callable[[], None] = lambda: None
        self._state_publishers = StatePublishers(node.publisher, clock=publishes_clock(values))
        if period := self._stepper.deadline_period:
            self._deadlines = host.loop.timer(period, self._stepper.pass_deadline)
        host.loop.timer(CHECK_PERIOD, self._check).reset()
        self._checked = 0

    def command(self, command: Command, stamp: int) -> None:
        """Take a command for the state stamped `stamp` [ns]; 0: it holds until the next."""
        why = self._stepper.refusal(stamp) or self._stepper.take_command(command, stamp)
        if why:
            self._node.warning(f'refused {why}', period=1.0)

    def tune(self, name: str, value: float) -> str:
        """Set a parameter while the run goes on; return why that is refused, or ''."""
        if why := self._node.tune(parameters(), name, value):
            return why
        self._change({name: value})
        return ''

    def pause(self, *, on: bool) -> None:
        """Pause simulated time, or resume it."""
        if self._stepper.pause(on=on):
            self._node.info('paused' if on else 'running')

    def reset(self) -> None:
        """Put the car back to the start."""
        self._stepper.reset()

    # What the stepper calls, beside the methods of `Simulator`.

    def publish_state(self, t: float, seen: Observation, stamp_ns: int) -> None:
        """Publish what was observed at `t` [s], stamped `stamp_ns` [ns], and have it answered."""
        super().publish_state(t, seen, stamp_ns)
        # Later, as an answer steps to the next state, which is answered again.
        self._host.loop.soon(partial(self._answer, stamp_ns, seen))

    def _answer(self, stamp: int, seen: Observation) -> None:
        command = self.on_state(stamp, seen)
        if command is not None:
            self.command(command, stamp)

    def begin(self) -> None:
        """Reset who commands, and start time."""
        self.on_reset()
        self._stepper.start()

    def prepare_start(self, why: str) -> None:
        """Begin anew."""
        self._host.loop.soon(self.begin)
        self._node.info(why)

    def finish(self) -> None:
        """End the run; may be called from any thread."""
        self.finished = True
        self._host.loop.call(lambda: None)  # wakes the loop

    def warn_missed(self, state: int, missed: int) -> None:
        """Warn of a missed deadline, once a second at most."""
        self._node.warning(missed_deadline(state, missed), period=1.0)

    def warn_timeout(self, timeout: float) -> None:
        """Warn that commands are lost, every ten seconds at most."""
        self._node.warning(commands_lost(timeout), period=10.0)

    def warn_behind(self, behind: float) -> None:
        """Warn that stamps are behind the wall clock, and publish `/clock` from now on."""
        self._state_publishers.begin_clock()
        self._node.warning(stamps_behind(behind, clock=True))

    def _check(self) -> None:
        self._stepper.check()
        # As the node does: a tick a second while time stands still.
        if self._stepper.phase is Phase.PAUSED and self.states == self._checked:
            self._state_publishers.publish_clock()
        self._checked = self.states


class LocalController:
    """Answers each state with a command.

    Attributes
    ----------
    values
        The parameters, by name.
    """

    def __init__(
        self,
        host: LocalHost,
        controller: Controller | None,
        given: Mapping[str, Any],
        acceleration_limit: float,
    ) -> None:
        """Use `controller`, or the one that the parameter `controller_type` names.

        Raises
        ------
        UserError
            where a parameter is out of range, or `controller` cannot work with them.
        """
        self._node = node = host.node('controller')
        self._control = CruiseControl(
            controller,
            partial(node.declare, given=given),
            acceleration_limit,
            refuse=lambda sentence: node.warning(f'refused {sentence()}', period=1.0),
            warn=lambda sentence: node.warning(sentence(), period=1.0),
        )
        self.values = self._control.values
        self.reset = self._control.reset
        self._publishers = AnswerPublishers(node.publisher, self._control)

    def tune(self, name: str, value: float) -> str:
        """Set a parameter while the run goes on; return why that is refused, or ''."""
        if why := self._node.tune(self._control.parameters(), name, value):
            return why
        self._control.configure({name: value})
        return ''

    def answer(self, stamp: int, seen: Observation) -> Command | None:
        """Return the command for the state stamped `stamp` [ns], and publish it."""
        subtract = self._control.values['subtract_error']
        speed = seen.measured.v_x - (seen.error.v_x if subtract else 0.0)
        answer = self._control.answer(stamp, speed)
        return None if answer is None else self._publishers.publish(stamp, answer)
