"""The cruise-control run: the PID holds a speed over the hills, or on a track.

It reads from top to bottom: make the nodes, add them to one executor, spin, close.
"""

from __future__ import annotations

from functools import partial
from math import inf, nan
from typing import TYPE_CHECKING

from barc_sim.control.cruise_control import PROFILE
from barc_sim.control.lane import LANE
from barc_sim.control.speed import ACCELERATION_LIMIT, KD, KI, KP, NO_LIMIT, PID, SPEED_REFERENCE
from barc_sim.lab.user_code.adapters import COMMANDS
from barc_sim.nodes.controller import CruiseController
from barc_sim.runs.composition import Run, engine
from barc_sim.runs.inputs import gains
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
from barc_sim.simulation.scenario import Scenario

if TYPE_CHECKING:
    from argparse import Namespace

    from barc_sim.cli.process import StopSignals
    from barc_sim.lab.user_code.code import UserCode
    from barc_sim.nodes.simulator import VehicleSimulator
    from barc_sim.runs.inputs import Inputs
    from barc_sim.simulation.metrics import Summary
    from barc_sim.vehicle.plant import Observation


def drive(options: Namespace, inputs: Inputs, stop: StopSignals) -> int:
    """Drive to the end of the road, or until `stop`; return the exit code.

    UserError: a parameter or a ROS argument cannot be used; no bag is left then.
    """
    with engine(options) as new_executor, Run(options, inputs, stop) as run:
        cars = [add_car(run, number) for number in range(options.cars)]
        if not options.quiet:
            cars[0].display = Display(cars[0].simulator.stepper.distance)
        run.prepare(cars[0].display)

        with new_executor() as executor:
            for node in run.nodes:
                executor.add_node(node)
            executor.spin_until_future_complete(run.finished)
            run.await_readers(executor)

        if failures := [failure for car in cars if (failure := car.failure)]:
            run.fail(f'{"; ".join(failures)}: the run has ended')
    return run.end(lambda: print_result(run, cars))


def add_car(run: Run, number: int) -> Car:
    """Add the controller and the simulator of a car to the run; a single car has no namespace.

    UserError: a parameter is out of range, or the topic is in use.
    """
    options, (road, track, user_code, *_) = run.options, run.inputs
    name = f'car{number + 1}' if options.cars > 1 else ''
    controller: CruiseController | None = None
    if not options.no_controller:
        law, lane = run.inputs.laws()
        is_free = user_code.controller or user_code.identify
        controller = run.add(
            CruiseController,
            {
                'speed_reference': options.speed,
                'reference': options.reference,
                'acceleration_limit': options.acceleration_limit,
                'controller_type': options.controller_type,
                'lane_type': None if lane else options.lane,
                **dict(zip((p.name for p in PROFILE), options.speed_profile or (), strict=False)),
                **{LANE + name: value for name, value in options.lane_gain},
                **gains(options),
            },
            controller=law,
            track=track,
            lane=lane,
            acceleration_limit=NO_LIMIT if is_free else ACCELERATION_LIMIT,
            namespace=name,
        )
    simulator = run.add_simulator(
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
        distance=0.0 if track else Scenario.distance,
        keeps_clock=number == 0,
        namespace=name,
    )
    distance = simulator.stepper.distance
    if controller and distance < inf and not controller.values['reference']:
        check_ahead(controller.values['speed_reference'], distance)
    return Car(run, name, controller, simulator)


def _identified(user_code: UserCode) -> dict[str, float]:
    """Return the parameters of the student's car of Lab 5; empty without `identify.py`."""
    if not user_code.identify:
        return {}
    from barc_sim.lab.labs.identify import NOISE, car_of  # noqa: PLC0415 (slow)

    car = car_of(user_code.name)
    return {
        'air_drag_coeff': car.vehicle.air_drag_coeff,
        'friction': car.vehicle.friction,
        'motor_delay': car.delay,
        'noise_v_x': NOISE,
    }


class Car:
    """Watches a simulator: adds its states to laps, and ends the run of a car without progress."""

    def __init__(
        self, run: Run, name: str, controller: CruiseController | None, simulator: VehicleSimulator
    ) -> None:
        """Watch from now on; `name` is empty for a single car."""
        options = run.options
        self.name, self.controller, self.simulator = name, controller, simulator
        self.display: Display | None = None
        self._laps, self.track_laps = Laps(), TrackLaps()
        self._progress = Progress(inf)
        self._duration = COMMANDS if run.inputs.user_code.identify else inf
        self._speed = SPEED_REFERENCE if options.speed is None else options.speed
        simulator.on_step = self.on_step

    def on_step(self, t: float, seen: Observation) -> None:
        """Add the state, `t` [s] after the start of its lap, to the lap, and show it.

        If the car makes no progress, the run ends.
        """
        if t == 0.0:
            self._progress = Progress(self.simulator.stepper.distance)
        speed, reference, place = seen.true.v_x, self._speed, seen.on_track
        x, measured = (place.s, place.s) if place else (seen.true.x, seen.measured.x)
        if self.controller:
            reference = self.controller.reference(t, measured)
        if place:
            # The command that made this state, which is not answered yet.
            servo = self.controller.lane.output if self.controller and self.controller.lane else 0.0
            self.track_laps.add(t, place.lap, place.lap_time, place.e_y, servo)
            line = partial(track_line, t, place, speed)
        else:
            theta_deg = seen.surroundings.theta
            lap = self._laps.add(t, x, seen.true.y, speed, reference, theta_deg)
            error = nan if self._duration < inf else reference - speed  # nan: no speed to hold
            line = partial(cruise_line, t, x, speed, error, theta_deg, lap)
        if self._progress.add(t, x, speed, reference, place) or t >= self._duration:
            self.simulator.stepper.end()
        if self.display:
            self.display.show(x, line)

    @property
    def failure(self) -> str:
        """Why the car will never arrive, with its name; empty if it can."""
        failure = self._progress.failure
        return f'{self.name}: {failure}' if self.name and failure else failure

    def summaries(self) -> dict[str, Summary]:
        """Return the summary of each lap's speed errors, by the name of the car, or of the lap."""
        laps, named = [*self._laps], {}
        for lap in laps:
            name = f'{lap.number + 1:3d}  {lap.start_distance:5.1f} to {lap.end_distance:5.1f} m'
            if self.name:
                name = self.name if len(laps) == 1 else f'{self.name} {name}'
            named[name] = lap.summary
        return named


def print_result(run: Run, cars: list[Car]) -> None:
    """Print the table of speed errors, and the gains and limit of a user's controller."""
    user_code, controller = run.inputs.user_code, cars[0].controller
    if user_code.controller and controller:
        print(f'controller  {_driven_with(run.options, user_code, controller)}')  # noqa: T201
    if user_code.tolerated:
        print(f'tolerated   {"; ".join(user_code.tolerated)}')  # noqa: T201
    if user_code.identify:
        return  # its commands hold no speed
    if cars[0].simulator.track:
        print_track_laps({car.name: car.track_laps for car in cars}, run.late)
        return
    summaries = {name: lap for car in cars for name, lap in car.summaries().items()}
    if len(summaries) > 1:
        print_summaries('car' if len(cars) > 1 else 'lap', summaries, run.late)
    else:
        print_summary(next(iter(summaries.values())), run.late)


def _driven_with(options: Namespace, user_code: UserCode, controller: CruiseController) -> str:
    """Return the gains and the limit of a user's controller."""
    from barc_sim.lab.files import ChosenGains  # noqa: PLC0415 (slow)

    chosen, named = user_code.gains or ChosenGains(KP, KI, KD, 'barc_sim'), gains(options)
    if named:
        rest = '' if len(named) == len(PID.gains) else f', the others from {chosen.origin}'
        chosen = chosen._replace(**named, origin=f'the command line{rest}')
    limit = controller.values['acceleration_limit']
    limited = 'without a limit' if limit >= NO_LIMIT else f'limited to {limit:g} m/s²'
    return f'{chosen}, {limited}'
