"""The state machine of a simulator: when it starts, steps, pauses, resets and ends.

`Pace` has the deadlines, `Commands` the command that is applied. Nothing here imports ROS or starts
a thread or timer: the node `vehicle_simulator` passes events to `Stepper`, and is its
`StepperHost`.

The applied command, which the topic `applied_command` has, is the input of the plant for a step:
the answer to the state, or without an answer the latest command. The values of the actuators,
`Plant.acting`, are another thing: they follow this command, and with a delay they do so later.
"""

from __future__ import annotations

import time
from enum import Enum
from math import inf, isfinite
from typing import TYPE_CHECKING, Annotated, Any, Literal, NamedTuple, Protocol

from barc_sim.errors import UserError
from barc_sim.interfaces.parameters import ParameterDeclaration, limited, parameters_of
from barc_sim.interfaces.records import Command
from barc_sim.interfaces.stamps import NANOSECONDS
from barc_sim.simulation.scenario import LIMITS
from barc_sim.vehicle.parameters import LIVE, ON_TRACK, PARAMETERS

if TYPE_CHECKING:
    from collections.abc import Callable

    from barc_sim.simulation.scenario import Scenario
    from barc_sim.vehicle.bike_model import BicycleState
    from barc_sim.vehicle.plant import Observation


#: Share of a period by which a deadline may be late and still counts as punctual.
PUNCTUAL = 0.1


class Pace:
    """The deadlines of a run in real time, one every `period` [s] of the wall clock.

    Attributes
    ----------
    slipped
        Periods by which simulated time has fallen behind the wall clock.
    """

    def __init__(self, period: float) -> None:
        """Set no deadline yet; `begin` does."""
        self.period = period
        self.slipped = 0
        self._due = 0.0

    def begin(self, now: float) -> None:
        """Set the next deadline to one period after `now` [s]."""
        self._due = now + self.period

    def pass_deadline(self, now: float) -> bool:
        """Set the next deadline; return whether this one was punctual.

        Lost time is not made up: whole periods since the deadline are counted in `slipped`.
        """
        late = max(now - self._due, 0.0)
        behind = int(late / self.period)
        self._due += (behind + 1) * self.period
        self.slipped += behind
        return late <= PUNCTUAL * self.period


NO_STAMP = 0  #: [ns] the stamp of a command that answers the present state


class Commands:
    """The commands that a simulator has received since its start.

    A command answers the state with the same stamp, or without a stamp, the present state. It
    replaces the applied command, unless it is older or the present state is answered already.
    So neither a late command nor one with a stamp in the future can displace the answer.

    Attributes
    ----------
    latest
        The applied command; None before the first one.
    timeout
        [s] Commands count as lost when none arrives for longer than this; inf: never.
    """

    def __init__(self, timeout: float = 0.0) -> None:
        """Begin before the first state.

        With a `timeout` [s] other than 0, commands are unsynchronised: a state has no deadline
        until a command arrives with exactly its stamp.
        """
        self.timeout = timeout or inf
        self.latest: Command | None = None
        self._unsynchronised = bool(timeout)  # no state waits: commands have no stamps
        self._answered_by_stamp = False  # a command has the present state's stamp
        self._latest_state = 0  # [ns] stamp of the state that `latest` belongs to
        self._received = -inf  # [s] when `latest` arrived

    @property
    def answered(self) -> bool:
        """Whether the present state need not wait for a command."""
        return self._unsynchronised or self._answered_by_stamp

    def store(self, command: Command, stamp: int, present: int, t: float) -> bool:
        """Store a `command` that arrived at `t` [s] in the state `present` [ns]: it is applied.

        Return False if its `stamp` [ns] is out of order: another command stays applied.
        """
        has_stamp = stamp != NO_STAMP
        is_answer = stamp == present
        # A stamp in the future counts as the present one.
        belongs_to = min(stamp, present) if has_stamp else present

        is_older = belongs_to < self._latest_state
        would_displace_answer = self._answered_by_stamp and has_stamp and not is_answer
        if is_older or would_displace_answer:
            return False

        self.latest = command
        self._latest_state = belongs_to
        self._received = t
        self._answered_by_stamp = is_answer
        if is_answer or not has_stamp:
            self._unsynchronised = not has_stamp
        return True

    def next_step(self) -> None:
        """Wait for the answer to the next state."""
        self._answered_by_stamp = False

    def start_timeout(self, t: float) -> None:
        """Measure the timeout from `t` [s], unless a command arrived later."""
        self._received = max(self._received, t)

    def timed_out(self, t: float) -> bool:
        """Return whether no command arrived for longer than the timeout, at `t` [s]."""
        return t - self._received > self.timeout


def out_of_order(stamp: int, present: int) -> str:
    """Return why a command with this `stamp` [ns] is not accepted in the state `present` [ns]."""
    away = (stamp - present) / NANOSECONDS
    return f'a command stamped {away:+g} s from the present state: a newer one or its answer holds'


RESET = 'reset: the car is back at the start'
_FAR = 1e6  #: [m] beyond which no car can be placed
#: Simulated seconds per second; besides, 0 is as fast as commands arrive.
REALTIME_FACTORS = (0.001, 1000.0)


@limited
class StepperOptions(NamedTuple):
    """How a simulator goes through a scenario: its pace, and the commands that it accepts."""

    realtime_factor: Annotated[
        float,
        'simulated seconds per second; 0: each step as soon as its command has arrived',
        0.0,
        REALTIME_FACTORS[1],
    ] = 1.0
    clock: Annotated[
        bool, 'whether to publish the simulated time on /clock even if realtime_factor is 1'
    ] = False
    wait_for_controller: Annotated[bool, 'whether time begins only once a node publishes ecu'] = (
        True
    )
    command_timeout: Annotated[
        float,
        'time without a command [s, wall clock] after which the car brakes; with it, states have '
        'no deadline until a command has a stamp; 0: never',
        0.0,
        3600.0,
    ] = 0.0
    timeout_braking: Annotated[float, 'deceleration after command_timeout [m/s²]', 0.0, 100.0] = 8.0
    refuse_motor_above: Annotated[float, 'maximum accepted command [m/s²]', 0.0, 1e6] = 100.0
    refuse_servo_above: Annotated[float, 'maximum accepted command [rad]', 0.0, 1.5] = 1.5


def parameters(distance: float = 0.0, *, on_track: bool = False) -> list[ParameterDeclaration]:
    """Return a simulator's parameters; `distance` [m] is the default of the parameter."""
    defaults: dict[str, Any] = {'distance': distance, 'laps': 1} | (ON_TRACK if on_track else {})
    table = (*PARAMETERS, *parameters_of(StepperOptions), LIMITS['distance'], LIMITS['laps'])
    return [
        each._replace(
            default=defaults.get(each.name, each.default), read_only=each.name not in LIVE
        )
        for each in table
    ]


class StepperHost(Protocol):
    """The methods that a `Stepper` calls; the node `vehicle_simulator` has them."""

    def publish_state(self, t: float, observation: Observation, stamp_ns: int) -> None:
        """Publish the state `t` [s] after the start, with its stamp [ns]."""

    def publish_applied(self, command: Command, stamp_ns: int, *, missed: bool) -> None:
        """Publish the command that is applied from the state with this stamp [ns] on.

        That is the latest state that was published. `missed`: no command answered it by its
        deadline, so that an earlier one is applied.
        """

    def run_deadlines(self, *, on: bool) -> None:
        """Start or stop calling `Stepper.pass_deadline` every `deadline_period`."""

    def defer_decision(self) -> None:
        """Call `Stepper.decide` once the commands that have arrived are delivered."""

    def prepare_start(self, reason: str) -> None:
        """Log `reason`, reset the node that commands, and call `Stepper.start` when it is ready."""

    def finish(self) -> None:
        """End the run; may be called from any thread."""

    def warn(self, sentence: Callable[[], str], about: str) -> None:
        """Warn about one thing, at most once in 10 s."""


class Phase(Enum):
    """The states of a `Stepper`."""

    STARTING = 'no state is published since the start or the latest reset'
    RUNNING = 'simulated time runs'
    PAUSED = 'simulated time stands still until it is resumed'
    FINISHED = 'the car is at its end'


class Stepper:
    """Steps a plant from state to state; each step takes the command that answers the state.

    A state is answered once a command for it has arrived (see `Commands`). In lock-step
    (`realtime_factor` 0) the answer triggers the step. Otherwise the deadline does, one for each
    period; if the state is unanswered, the latest command is applied, and `missed` counts it.

    One thread at a time may call it: all callbacks of the simulator's node are in its default
    callback group, which is mutually exclusive.

    =========  ===================  ======================  =====================================
    phase      event                condition               effect and next phase
    =========  ===================  ======================  =====================================
    STARTING   start                                        publish: RUNNING, or PAUSED
    STARTING   pause, resume                                choose the phase after the start
    RUNNING    command              answers, lock-step      step
    RUNNING    deadline             answered                step
    RUNNING    deadline             unanswered, punctual    count a missed command, step
    RUNNING    deadline             unanswered, late        count a slipped period
    RUNNING    pause                                        PAUSED
    PAUSED     single step          answered                step
    PAUSED     single step          unanswered              step when a command answers
    PAUSED     resume               answered, lock-step     RUNNING, step
    PAUSED     resume               otherwise               RUNNING
    both       reset, place         answered                STARTING
    both       reset, place         unanswered              STARTING at answer, deadline or check
    both       step                 lap is at its end       STARTING, or FINISHED after the last
    FINISHED   reset, place                                 STARTING
    =========  ===================  ======================  =====================================

    A step publishes the applied command, and the next state. From a state at or beyond
    `distance` it ends the lap: the next lap begins as after a reset, and the last one leads to
    FINISHED; so does any step after `end`. If commands are lost, the car brakes. STARTING begins
    with a new plant, at the start or where `place` puts it, and no command. Other events change
    nothing in a phase, except that a command is stored for the next step.

    Stamps begin with the wall clock, and grow by one period a step, also over a reset. In real time
    (`realtime_factor` 1) a pause or a slip leaves them `stamp_lag` behind the wall clock; a reset
    sets them to the wall clock again.

    Attributes
    ----------
    states
        States published.
    missed
        Commands that had not arrived when they were due.
    stamp
        Time [ns] with which the latest state is stamped; 0 before the first.
    stamp_lag
        Time [s] by which the latest stamp in real time was behind the wall clock; 0 at other paces.
    distance
        Position [m] at which each lap of a road ends, or a run on a track; inf: none.
    laps
        Laps driven to their end, without those that a reset has cut short.
    """

    def __init__(
        self,
        scenario: Scenario,
        options: StepperOptions,
        host: StepperHost,
        *,
        clock: Callable[[], float] = time.monotonic,
        wall_clock: Callable[[], int] = time.time_ns,
    ) -> None:
        """Begin in STARTING, with the plant and the end of `scenario`.

        On a track laps follow one another without a stop. `clock` [s] paces the steps, and
        `wall_clock` [ns] gives the first stamp.

        Raises
        ------
        UserError
            if fields of the scenario or of the options contradict one another.
        """
        factor = options.realtime_factor
        low, high = REALTIME_FACTORS
        if 0.0 < factor < low:
            raise UserError(
                f'realtime_factor {factor:g} is too small: expected 0, or {low:g} to {high:g}'
            )
        if scenario.laps != 1 and not (scenario.distance or scenario.track):
            raise UserError(
                f'laps {scenario.laps} with distance 0, at which no lap ends: expected a distance '
                'above 0, or one lap'
            )

        # What is driven.
        self._scenario = scenario
        self._plant = scenario.plant()
        if self._plant.track:
            self._plant.track.check_laps(scenario.laps)
        self.distance = scenario.end
        self._laps = scenario.laps

        # How it is driven.
        self._max_command = Command(options.refuse_motor_above, options.refuse_servo_above)
        self._timeout = options.command_timeout
        self._braking = options.timeout_braking
        self._in_real_time = factor == 1.0
        self._host = host
        self._clock = clock
        self._wall_clock = wall_clock
        self._period_ns = round(self._plant.ts * NANOSECONDS)
        self._pace = Pace(self._plant.ts / factor) if factor else None

        # The present state of the run.
        self.phase = Phase.STARTING
        self.paused = False
        self._commands = Commands(self._timeout)
        self.stamp = 0
        self.stamp_lag = 0.0
        self._first_stamp = 0  # since the start or the latest reset
        self._first_state = 0
        self._warned_of_stamps = False

        # The counts of the run.
        self.states = 0
        self.missed = 0
        self.laps = 0

        # What is to be done.
        self._is_retuned = False  # before the next step
        self._ends = False
        self._request: Literal['step', 'reset'] | None = None  # once the state is answered
        self._undecided: Literal['punctual', 'late'] | None = None  # the deadline that has passed
        self._start: BicycleState | None = None  # after the requested reset; None: the scenario's

    @property
    def slipped(self) -> int:
        """Periods by which simulated time has fallen behind the wall clock."""
        return self._pace.slipped if self._pace else 0

    @property
    def deadline_period(self) -> float | None:
        """Time [s] between two deadlines by the wall clock; None in lock-step."""
        return self._pace.period if self._pace else None

    def start(self) -> None:
        """Publish the first state, before which there is none, and run unless paused."""
        self.phase = Phase.PAUSED if self.paused else Phase.RUNNING
        self.stamp = self.stamp + self._period_ns if self.stamp else self._wall_clock()
        if self._in_real_time:
            self.stamp = max(self.stamp, self._wall_clock())
        self._first_stamp = self.stamp
        self._commands.start_timeout(self._clock())
        self._publish()
        self._start_deadlines()

    def take_command(self, command: Command, stamp: int) -> str | None:
        """Store a command with this `stamp` [ns; 0: none], and take the step that waits for it.

        Return why it is refused, if it is.
        """
        limit = self._max_command
        # Written so that NaN is out of range, too.
        if not (abs(command.motor) <= limit.motor and abs(command.servo) <= limit.servo):
            return (
                f'a command beyond ±{limit.motor:g} m/s² or ±{limit.servo:g} rad: '
                f'{command.motor}, {command.servo}'
            )

        if stamp not in (NO_STAMP, self.stamp):
            self._check_stamp(stamp)
        if not self._commands.store(command, stamp, self.stamp, self._clock()):
            return out_of_order(stamp, self.stamp)

        lock_step = self.phase is Phase.RUNNING and not self._pace
        if self._commands.answered and (lock_step or self._request):
            self._step()
        return None

    def pass_deadline(self) -> None:
        """Step, as the next state is due; if the present one is unanswered, `decide` later."""
        if not self._pace:
            return
        punctual = self._pace.pass_deadline(self._clock())
        if self.phase is not Phase.RUNNING:
            return
        if self._commands.answered:
            self._step()
        else:  # the answer may have arrived, but not been delivered
            self._undecided = 'punctual' if punctual else 'late'
            self._host.defer_decision()

    def decide(self) -> None:
        """Step, or let a late deadline slip, once all commands that have arrived are delivered."""
        deadline = self._undecided
        self._undecided = None
        if not (deadline and self._pace):
            return

        is_missed = not self._commands.answered
        if is_missed:
            if deadline == 'late':
                # The machine held up the whole process, perhaps the controller, too: it gets
                # another period to answer.
                self._pace.slipped += 1
                return
            self.missed += 1
            self._host.warn(
                lambda: (
                    f'missed deadlines: {self.missed} so far; no command answers state '
                    f'{self.states - 1} in time, and the last one holds'
                ),
                'missed deadlines',
            )
        self._step(missed=is_missed)

    def pause(self, *, on: bool) -> bool:
        """Pause simulated time, or resume it; return whether that is a change."""
        is_change = self.paused != on
        self.paused = on
        if on and self.phase is Phase.RUNNING:
            self.phase = Phase.PAUSED
            self._stop_deadlines()
        elif not on and self.phase is Phase.PAUSED:
            self.phase = Phase.RUNNING
            if self._request == 'step':
                self._request = None
            if not self._pace and self._commands.answered:
                self._step()
            self._start_deadlines()
        return is_change

    def single_step(self) -> tuple[bool, str]:
        """Take one step while paused; return whether that is possible, and a sentence."""
        if self.phase is Phase.STARTING:
            return False, 'not begun yet'
        if self.phase is Phase.RUNNING:
            return False, 'time runs: pause it first'
        if self.phase is Phase.FINISHED:
            return False, 'the run has ended'

        self._request = self._request or 'step'
        if not self._commands.answered:
            return True, f'state {self.states - 1} is not answered yet: the step follows'
        self._step()
        return True, f'state {self.states - 1}'

    def retune(self, scenario: Scenario) -> None:
        """Give the plant the `LIVE` parameters of `scenario` before the next step.

        Later starts are its plant's, too. May be called from any thread.
        """
        self._scenario = scenario
        self._is_retuned = True

    def reset(self) -> bool:
        """Put the car back to the start once the present state is answered; return whether now."""
        return self._reset_to(None)

    def place(self, state: BicycleState) -> str | None:
        """Put the car there as `reset` puts it back to the start; return why it is refused."""
        # Written so that NaN is out of range, too.
        if not (abs(state.x) <= _FAR and abs(state.y) <= _FAR and isfinite(state.psi)):
            return (
                f'an initial pose at x {state.x:g} m, y {state.y:g} m, heading {state.psi:g} rad: '
                f'expected at most {_FAR:g} m either way, and a rotation'
            )
        track = self._plant.track
        if track:
            e_y = track.frenet(state.x, state.y, state.psi).e_y
            if abs(e_y) > 0.5 * track.width:
                return (
                    f'an initial pose {abs(e_y):.2f} m from the centre line: expected one on the '
                    f'track, at most {0.5 * track.width:g} m from it'
                )
        self._reset_to(state)
        return None

    def _reset_to(self, start: BicycleState | None) -> bool:
        """Begin a run in this state, as `reset` does; return whether now."""
        self._start = start
        if self._commands.answered or self.phase in {Phase.STARTING, Phase.FINISHED}:
            self._restart()
            return True
        self._request = 'reset'
        return False

    def end(self) -> None:
        """End the run as if the car were at `distance`: once the present state is answered."""
        self._ends = True

    def check(self) -> None:
        """Reset now if a reset waits for an answer; to be called about once a second."""
        if self._request == 'reset':
            self._restart()

    def _step(self, *, missed: bool = False) -> None:
        """Take the step to the next state, or do what was requested in its place."""
        is_lost = self._commands.timed_out(self._clock())
        command = self._command_to_apply(is_lost=is_lost)
        # Also where no step follows: then the records of a run are as many as its missed commands.
        self._host.publish_applied(command, self.stamp, missed=missed)

        request = self._request
        self._request = None
        if request == 'reset':
            self._restart()
            return
        if self._ends or self._plant.distance >= self.distance:
            self._end_lap()
            return

        if is_lost:
            self._host.warn(
                lambda: f'no command for {self._timeout:g} s: the car brakes',
                'timeout',
            )
        self._advance(command)

    def _command_to_apply(self, *, is_lost: bool) -> Command:
        """Return the command for the next step: the latest one.

        While commands are lost, it is the driver's brake, with the steering of the latest one.
        """
        latest = self._commands.latest or Command()
        if not is_lost:
            return latest
        # Half of what would stop the car in the relay's period.
        motor = max(-self._braking, min(-10.0 * self._plant.state.v, self._braking))
        return latest._replace(motor=motor)

    def _advance(self, command: Command) -> None:
        """Move the car by a step with a command, and publish the next state."""
        if self._is_retuned:
            self._is_retuned = False
            self._scenario.retune(self._plant)

        self._plant.advance(command)
        self._commands.next_step()
        self.stamp += self._period_ns
        self._publish()

    def _end_lap(self) -> None:
        """Begin the next lap, or end the run after the last."""
        if not self._ends:
            self.laps += 1
            if self._plant.track:
                self.laps = self._plant.lap
            elif self.laps != self._laps:
                self._restart(f'lap {self.laps} is finished: the next one begins')
                return
        self.phase = Phase.FINISHED
        self._stop_deadlines()
        self._host.finish()

    def _publish(self) -> None:
        if self._in_real_time:
            self.stamp_lag = max((self._wall_clock() - self.stamp) / NANOSECONDS, 0.0)
        t = (self.states - self._first_state) * self._plant.ts
        self._host.publish_state(t, self._plant.observe(), self.stamp)
        self.states += 1

    def _check_stamp(self, stamp: int) -> None:
        """Warn, once, of a command with a stamp [ns] that no state has."""
        since = stamp - self._first_stamp
        # A command from before a reset may arrive after it.
        is_of_this_start = since > 0 or not self._first_state
        is_late_answer = stamp < self.stamp and not since % self._period_ns
        starting = self.phase is Phase.STARTING
        if self._warned_of_stamps or starting or is_late_answer or not is_of_this_start:
            return

        self._warned_of_stamps = True
        away = (stamp - self.stamp) / NANOSECONDS
        warning = (
            f'commands arrive stamped {away:+.3g} s from the state: copy its header, or leave the '
            'stamp 0'
        )
        self._host.warn(lambda: warning, 'stamps of commands')

    def _restart(self, reason: str = RESET) -> None:
        if self.phase is Phase.FINISHED:
            self.laps = 0
        self.phase = Phase.STARTING
        self._request = None
        self._ends = False
        self._stop_deadlines()

        self._plant = self._scenario.plant()
        start = self._start
        self._start = None
        if start:
            self._plant.place(start)
            reason = f'reset: the car is at x {start.x:.2f} m, y {start.y:.2f} m'
        self._commands = Commands(self._timeout)
        self._first_state = self.states
        self._host.prepare_start(reason)

    def _start_deadlines(self) -> None:
        if self._pace and self.phase is Phase.RUNNING:
            self._pace.begin(self._clock())
            self._host.run_deadlines(on=True)

    def _stop_deadlines(self) -> None:
        self._undecided = None
        self._host.run_deadlines(on=False)
