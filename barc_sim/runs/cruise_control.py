"""The cruise-control run: the PID holds a speed over the hills, or on a track."""

from __future__ import annotations

from copy import copy
from dataclasses import replace
from functools import partial
from itertools import pairwise
from math import inf
from typing import TYPE_CHECKING, Any

from barc_sim.control.cruise_control import (
    DEFAULT_LANE,
    DEFAULT_TYPE,
    LANE_TYPES,
    PROFILE,
    TYPES,
    reference_of,
)
from barc_sim.control.lane import LANE
from barc_sim.control.speed import (
    ACCELERATION_LIMIT,
    KD,
    KI,
    KP,
    NO_LIMIT,
    PID,
    SPEED_REFERENCE,
    gain_parameters,
)
from barc_sim.errors import UserError
from barc_sim.lab.user_code.adapters import COMMANDS, UserCommands, UserController, UserLane
from barc_sim.nodes.controller import CruiseController
from barc_sim.runs.composition import Run, carrier, check_left_out, read_inputs
from barc_sim.runs.terminal import (
    Display,
    cruise_line,
    print_summaries,
    print_summary,
    print_track_laps,
    track_line,
)
from barc_sim.simulation.closed_loop import Progress, check_ahead
from barc_sim.simulation.metrics import Laps, TrackLaps

if TYPE_CHECKING:
    from argparse import Namespace
    from collections.abc import Iterable

    from barc_sim.cli.process import StopSignals
    from barc_sim.lab.user_code.code import UserCode
    from barc_sim.learning.tasks import Policy
    from barc_sim.runs.composition import Inputs
    from barc_sim.simulation.metrics import Summary
    from barc_sim.vehicle.plant import Observation, TrackState

#: [m] The lab's road ends there.
_DISTANCE = 180.0
#: What a policy drives in place of: options, and parts of a lab's folder.
_STEERING = ('lane', 'lane_gain')
_DRIVING = (*PID.gains, 'gain', 'controller_type', 'controller', 'identify')
_OF_CONTROLLER = ('acceleration_limit', 'controller_type', 'reference', 'lane', 'speed_profile')


def drive(options: Namespace, stop: StopSignals) -> int:
    """Drive to the end of the road, or until `stop`; return the exit code.

    UserError: an option, a user's file or a ROS argument cannot be used; no bag is left then.
    """
    inputs = read_inputs(options)
    policy = _check(options, inputs)
    # One car alone needs no namespace.
    namespaces = [f'car{k + 1}' for k in range(options.cars)] if options.cars > 1 else ['']
    with carrier(options) as new_executor, Run(options, inputs, stop) as run:
        cars = [Car(run, name, number, copy(policy)) for number, name in enumerate(namespaces)]
        if not options.quiet:
            cars[0].display = Display(cars[0].distance)
        run.show(cars[0].display)

        with new_executor() as executor:
            run.spin(executor)

        if failures := [failure for car in cars if (failure := car.failure)]:
            run.fail(f'{"; ".join(failures)}: the run has ended')
    return run.end(lambda: _print_result(run, cars))


class Car:
    """A simulator with its controller, the laps of the car, and whether it makes progress."""

    def __init__(self, run: Run, namespace: str, number: int, policy: Policy | None = None) -> None:
        """Add the nodes of the car `number` to the run, in a namespace; `policy` drives if given.

        UserError: a parameter is out of range, or the topic is taken.
        """
        options, (road, track, user_code, _) = run.options, run.inputs
        self.name = namespace
        self.display: Display | None = None
        self._laps, self.track_laps = Laps(), TrackLaps()
        self._missed = [0]  # deadlines, before each lap
        self._progress, self._off = Progress(inf), ''
        self._duration = COMMANDS if user_code.identify else inf
        self.controller: CruiseController | None = None
        if not options.no_controller:
            controller, lane = _laws(run.inputs, policy)
            is_free = user_code.controller or user_code.identify
            self.controller = run.add(
                CruiseController,
                {
                    'speed_reference': options.speed,
                    'reference': options.reference,
                    'acceleration_limit': options.acceleration_limit,
                    'controller_type': options.controller_type,
                    'lane_type': None if lane else options.lane,
                    **_profile(options),
                    **{LANE + name: value for name, value in options.lane_gain},
                    **_gains(options),
                },
                controller=controller,
                track=track,
                lane=lane,
                acceleration_limit=NO_LIMIT if is_free else ACCELERATION_LIMIT,
                namespace=namespace,
            )
        self._speed = SPEED_REFERENCE if options.speed is None else options.speed
        self.simulator = run.add_simulator(
            {
                'distance': options.distance,
                'laps': options.laps,
                'road': road and road.name,
                # Each car has its own noise.
                'seed': (options.seed or 0) + number if number else options.seed,
                'refuse_motor_above': NO_LIMIT if user_code.controller else None,
                **_identified(user_code),
            },
            road=road,
            track=track,
            distance=0.0 if track else _DISTANCE,
            keeps_clock=number == 0,
            on_step=self._on_step,
            namespace=namespace,
        )
        end = self.simulator.stepper.distance
        self.distance = 0.0 if end == inf else end  #: [m] of the way; 0: it does not end
        if self.controller and not self.controller.values['reference']:
            check_ahead(self.controller.values['speed_reference'], self.distance)

    def _on_step(self, t: float, seen: Observation) -> None:
        """Add the state, `t` [s] after the start of its lap, to the lap, and show it.

        The run of a car that makes no progress ends.
        """
        if t == 0.0:
            self._progress, self._off = Progress(self.distance or inf), ''
        x, y, speed, reference = seen.true.x, seen.true.y, seen.true.v_x, self._speed
        place, measured = seen.on_track, seen.measured.x
        if place:
            x, y = measured, _ = place.s, place.e_y
        if self.controller:
            reference = self.controller.reference(t, measured)
        theta_deg = seen.surroundings.theta
        lap = self._laps.add(t, x, y, speed, reference, theta_deg)
        if lap == len(self._missed):
            self._missed.append(self.simulator.stepper.missed)
        if self._progress.add(t, x, speed, reference) or t >= self._duration:
            self.simulator.stepper.end()
        if place:
            self._add_place(t, place)
        if not self.display:
            return
        if place:
            self.display.show(x, partial(track_line, t, place, speed))
        else:
            error = reference - speed
            self.display.show(x, partial(cruise_line, t, x, speed, error, theta_deg, lap))

    def _add_place(self, t: float, place: TrackState) -> None:
        """Add the place to the laps of the track; the run of a car beyond its edge ends."""
        # The command that made this state, which is not answered yet.
        servo = self.controller.lane.output if self.controller and self.controller.lane else 0.0
        self.track_laps.add(t, place.lap, place.lap_time, place.e_y, servo)
        track = self.simulator.track
        if track and abs(place.e_y) > 0.5 * track.width:
            side = 'left' if place.e_y > 0.0 else 'right'
            self._off = f'the car left the track to the {side} at {place.s:.1f} m'
            self.simulator.stepper.end()

    @property
    def failure(self) -> str:
        """What a car does that never arrives, with its name; empty for others."""
        failure = self._progress.failure or self._off
        return f'{self.name}: {failure}' if self.name and failure else failure

    def summaries(self) -> dict[str, Summary]:
        """Return the summary of each lap's speed errors, by the name of the car, or of the lap."""
        laps = [*self._laps]
        counts = [*self._missed, self.simulator.stepper.missed]
        missed = [after - before for before, after in pairwise(counts)]
        named = {}
        for lap, count in zip(laps, missed[-len(laps) :], strict=True):
            name = f'{lap.number + 1:3d}  {lap.start_distance:5.1f} to {lap.end_distance:5.1f} m'
            if self.name:
                name = self.name if len(laps) == 1 else f'{self.name} {name}'
            named[name] = replace(lap.summary, missed_deadlines=count)
        return named


def _check(options: Namespace, inputs: Inputs) -> Policy | None:
    """Refuse, before a bag is begun, options that the run's controller or track does not have.

    Returns the policy that drives, if one does.
    """
    user_code = inputs.user_code
    if inputs.track:
        inputs.track.check_laps(1 if options.laps is None else options.laps)
        _check_lane(options, user_code)
    else:
        for name in ('lane', 'lane_gain', 'speed_profile'):
            if getattr(options, name):
                option = name.replace('_', '-')
                raise UserError(f'--{option} is for a track: give one, as in --track L')
        if user_code.lane and not (user_code.model or user_code.controller):
            raise UserError('lane.py is for a track: give one, as in --track L')
    if options.controller_type and (user_code.controller or user_code.identify):
        raise UserError(
            f"--controller-type {options.controller_type} names a controller of barc_sim's, and "
            '--lab or --controller gives another: give one of the two only'
        )
    if options.no_controller:
        names = (*PID.gains, 'controller', 'policy', *_OF_CONTROLLER)
        own = {name.replace('_', '-'): getattr(options, name) for name in names}
        own |= {f'gain {name}': value for name, value in options.gain}
        own |= {f'lane-gain {name}': value for name, value in options.lane_gain}
        check_left_out('controller', own)
    policy = _checked_policy(options, inputs) if options.policy else None
    if options.reference:
        reference_of(options.reference)
    _gains(options)
    return policy


def _checked_policy(options: Namespace, inputs: Inputs) -> Policy:
    """Return the policy, and set its speed; refuse one that cannot drive, or not alone."""
    _refuse_beside_policy(options, inputs.user_code, _STEERING if inputs.track else _DRIVING)
    policy = _policy(options, inputs)
    if 'motor' in policy.task.actions:
        _refuse_beside_policy(options, inputs.user_code, _DRIVING)
    if options.speed is None:
        options.speed = policy.task.speed
    return policy


def _refuse_beside_policy(options: Namespace, user_code: UserCode, names: Iterable[str]) -> None:
    """Refuse those of these options and files that are given."""
    for name in names:
        other = ''
        if getattr(options, name, None) not in (None, []):
            other = f'--{name.replace("_", "-")}'
        elif name in user_code.paths:
            other = f'{user_code.paths[name].name}, which --lab gives,'
        if other:
            raise UserError(f'--policy and {other} both drive: give one of the two only')


def _policy(options: Namespace, inputs: Inputs) -> Policy:
    """Return the policy, of the first environment whose observation it takes."""
    from barc_sim.learning.tasks import Policy, onnx_policy  # noqa: PLC0415 (slow)

    file, arguments = options.policy, {'speed': options.speed}
    if options.acceleration_limit:
        arguments['acceleration_limit'] = options.acceleration_limit
    arguments |= {'track': inputs.track} if inputs.track else {'road': inputs.road}
    takes = onnx_policy(file) if file.suffix == '.onnx' else inputs.user_code.function('policy')

    def of_task(task: str) -> Policy | str:
        try:
            return Policy(takes, task, **arguments)
        except UserError as error:
            return f'in {task}-v0, {error}'

    failures = []
    for found in map(of_task, ('Lane', 'Race') if inputs.track else ('Hills',)):
        if not isinstance(found, str):
            return found
        failures.append(found)
    raise UserError(f'--policy {str(file)!r}: {"; ".join(failures)}')


def _laws(inputs: Inputs, policy: Policy | None) -> tuple[Any, Any]:
    """Return the user's speed controller and steering law; None: barc_sim's own."""
    controller: Any = None
    code = inputs.user_code
    if code.identify:
        controller = UserCommands(code)
    elif code.controller:
        controller = UserController(code)
    if inputs.track:
        return controller, policy or (UserLane(code) if code.lane else None)
    return policy or controller, None


def _identified(user_code: UserCode) -> dict[str, float]:
    """Return the parameters of the car that a student identifies; none without `identify.py`."""
    if not user_code.identify:
        return {}
    from barc_sim.lab.labs.identify import NOISE, car_of  # noqa: PLC0415 (slow)

    car = car_of(user_code.name)
    vehicle = car.vehicle
    return {
        'air_drag_coeff': vehicle.air_drag_coeff,
        'friction': vehicle.friction,
        'motor_delay': car.delay,
        'noise_v_x': NOISE,
    }


def _check_lane(options: Namespace, user_code: UserCode) -> None:
    """Refuse options that the lane controller of a run does not have."""
    if user_code.lane and isinstance(options.lane, str):
        raise UserError(
            f"--lane {options.lane} names a law of barc_sim's, and --lab gives lane.py: give one "
            'of the two only'
        )
    if options.speed_profile and options.reference:
        raise UserError('--speed-profile and --reference both give the speed: give one of them')
    name = 'of lane.py' if user_code.lane else options.lane or DEFAULT_LANE
    law: Any = UserLane(user_code) if user_code.lane else LANE_TYPES[name]()
    _check_gains(f'the law {name}', law, options.lane_gain)


def _check_gains(what: str, law: Any, given: Iterable[tuple[str, float]]) -> None:  # noqa: ANN401
    """Refuse gains that a controller does not have, or that are out of its limits."""
    rows = {each.name: each for each in gain_parameters(law)}
    for name, value in given:
        if name not in rows:
            names = ', '.join(rows)
            raise UserError(f'{name} = {value:g}: {what} has no such gain; expected one of {names}')
        rows[name].check(value)


def _profile(options: Namespace) -> dict[str, float]:
    """Return the limits of the speed profile, by parameter."""
    return dict(zip((each.name for each in PROFILE), options.speed_profile or (), strict=False))


def _gains(options: Namespace) -> dict[str, float]:
    """Return the gains that the command line gives, by name.

    UserError: the controller has no such gain.
    """
    kind = options.controller_type or DEFAULT_TYPE
    named = {name: getattr(options, name) for name in PID.gains}
    gains = {name: value for name, value in named.items() if value is not None}
    gains |= dict(options.gain)
    _check_gains(f'the controller {kind}', TYPES[kind](), gains.items())
    return gains


def _print_result(run: Run, cars: list[Car]) -> None:
    """Print the table of speed errors, and what a user's code drove with."""
    user_code, controller = run.inputs.user_code, cars[0].controller
    if user_code.controller and controller:
        print(f'controller  {_driven_with(run.options, user_code, controller)}')  # noqa: T201
    if user_code.tolerated:
        print(f'tolerated   {"; ".join(user_code.tolerated)}')  # noqa: T201
    if user_code.identify:
        return  # its commands hold no speed
    summaries = {name: lap for car in cars for name, lap in car.summaries().items()}
    if cars[0].simulator.track:
        missed = sum(car.simulator.stepper.missed for car in cars)
        print_track_laps({car.name: car.track_laps for car in cars}, missed, run.slipped)
    elif len(cars) > 1:
        print_summaries('car', summaries, run.slipped)
    elif len(summaries) > 1:
        print_summaries('lap', summaries, run.slipped)
    else:
        print_summary(next(iter(summaries.values())), run.slipped)


def _driven_with(options: Namespace, user_code: UserCode, controller: CruiseController) -> str:
    """Return the gains and the limit of a user's controller."""
    from barc_sim.lab.user_code.source import ChosenGains  # noqa: PLC0415 (slow)

    gains, named = user_code.gains or ChosenGains(KP, KI, KD, 'barc_sim'), _gains(options)
    if named:
        rest = '' if len(named) == len(PID.gains) else f', the others from {gains.origin}'
        gains = gains._replace(**named, origin=f'the command line{rest}')
    limit = controller.values['acceleration_limit']
    limited = 'without a limit' if limit >= NO_LIMIT else f'limited to {limit:g} m/s²'
    return f'{gains}, {limited}'
