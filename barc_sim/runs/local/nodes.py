"""The simulator and the controller of a run without ROS: they call what their nodes in ROS call."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any

from barc_sim.control.cruise_control import CruiseControl
from barc_sim.simulation.publishers import AnswerPublishers, StatePublishers
from barc_sim.simulation.stepper import Phase, Settings, Stepper, parameters
from barc_sim.vehicle.parameters import plant, retune
from barc_sim.vehicle.road import Road

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from barc_sim.control.controller import Controller
    from barc_sim.runs.local.host import LocalHost
    from barc_sim.vehicle.bike_model import Command, Model
    from barc_sim.vehicle.plant import Observation


class LocalSimulator:
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
        self.values = values = node.declare(parameters(distance), given)
        self.road = road or Road.named(values['road'])
        new_plant = partial(plant, values, model, self.road)
        self.stepper = Stepper(new_plant, self, Settings.of_parameters(values))
        self._on_step = on_step
        self.finished = False
        self.on_state: Callable[[int, Observation], Command | None] = lambda *_: None
        self.on_reset: Callable[[], None] = lambda: None
        clock = values['clock'] or values['realtime_factor'] != 1.0
        self._state_publishers = StatePublishers(node.publisher, clock=clock)
        self._deadlines = None
        if period := self.stepper.deadline_period:
            self._deadlines = host.loop.timer(period, self.stepper.pass_deadline)
        host.loop.timer(1.0, self._check).reset()
        self._checked = 0

    @property
    def keeps_clock(self) -> bool:
        """Whether it publishes `/clock`."""
        return self._state_publishers.keeps_clock

    def command(self, command: Command, stamp: int) -> None:
        """Take a command for the state stamped `stamp` [ns]; 0: it holds until the next."""
        if why := self.stepper.take_command(command, stamp):
            self._node.warning(f'refused {why}', period=1.0)

    def tune(self, name: str, value: float) -> str:
        """Set a parameter while the run goes on; return why that is refused, or ''."""
        if why := self._node.tune(parameters(), name, value):
            return why
        self.values[name] = value
        self.stepper.change(partial(retune, self.values))
        return ''

    def pause(self, *, on: bool) -> None:
        """Pause simulated time, or resume it."""
        if self.stepper.pause(on=on):
            self._node.info('paused' if on else 'running')

    def reset(self) -> None:
        """Put the car back to the start."""
        self.stepper.reset()

    def publish_state(self, t: float, seen: Observation, stamp_ns: int) -> None:
        """Publish what was observed at `t` [s], stamped `stamp_ns` [ns], and have it answered."""
        self._state_publishers.publish(seen, stamp_ns)
        self._on_step(t, seen)
        # Later, as an answer steps to the next state, which is answered again.
        self._host.loop.soon(partial(self._answer, stamp_ns, seen))

    def _answer(self, stamp: int, seen: Observation) -> None:
        command = self.on_state(stamp, seen)
        if command is not None:
            self.command(command, stamp)

    def run_deadlines(self, *, on: bool) -> None:
        """Start or stop the timer of the deadlines."""
        if self._deadlines:
            (self._deadlines.reset if on else self._deadlines.cancel)()

    def defer_decision(self) -> None:
        """Decide after what is ready."""
        self._host.loop.soon(self.stepper.decide)

    def begin(self) -> None:
        """Reset who commands, and start time."""
        self.on_reset()
        self.stepper.start()

    def prepare_start(self, why: str) -> None:
        """Begin anew."""
        self._host.loop.soon(self.begin)
        self._node.info(why)

    def finish(self) -> None:
        """End the run; may be called from any thread."""
        self.finished = True
        self._host.loop.call(lambda: None)  # wakes the loop

    def warn(self, sentence: str, period: float) -> None:
        """Warn once in `period` [s] at most."""
        self._node.warning(sentence, period=period)

    def begin_clock(self) -> bool:
        """Publish `/clock` from now on."""
        self._state_publishers.begin_clock()
        return True

    def _check(self) -> None:
        self.stepper.check()
        # As the node does: a tick a second while time stands still.
        if self.stepper.phase is Phase.PAUSED and self.stepper.states == self._checked:
            self._state_publishers.publish_clock()
        self._checked = self.stepper.states


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
