"""The cruise-control run: the PID holds a speed over the hills."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from math import inf
from typing import TYPE_CHECKING

from barc_sim.control.pid import ACCELERATION_LIMIT, NO_LIMIT, PID, SPEED_REFERENCE
from barc_sim.control.types import DEFAULT_TYPE, TYPES
from barc_sim.errors import UserError
from barc_sim.lab.user_code.adapters import UserController
from barc_sim.runs.composition import Run, check_left_out, given
from barc_sim.runs.terminal.display import (
    CruiseStatus,
    display,
    print_summaries,
    print_summary,
)
from barc_sim.simulation.metrics import Laps
from barc_sim.simulation.progress import Progress
from barc_sim.vehicle.bike_model import bikeFE

if TYPE_CHECKING:
    from argparse import Namespace
    from collections.abc import Callable

    from barc_sim.cli.signals import StopSignals
    from barc_sim.nodes.simulator import VehicleSimulator
    from barc_sim.runs.composition import Setup
    from barc_sim.runs.terminal.display import Status
    from barc_sim.simulation.metrics import Summary
    from barc_sim.vehicle.plant import Observation

#: [m] The lab's road ends there.
_DISTANCE = 180.0


class CruiseControl(Run):
    """The run with a controller, ours unless it is left out, and a simulator for each car."""

    _driven_with = ''  #: gains and limit of a user's controller

    def compose(self, setup: Setup) -> list[VehicleSimulator]:
        """Return the simulators, one for each car.

        Raises
        ------
        UserError
            if an option is for a controller that the run does not have.
        """
        options = setup.options
        if options.controller_type and setup.user_code.controller:
            raise UserError(
                f"--controller-type {options.controller_type} names a controller of barc_sim's, "
                'and --lab or --controller gives another: give one of the two only'
            )
        if options.no_controller:
            _check_no_options_for_controller(options)
        # One car alone needs no namespace.
        namespaces = [f'car{k + 1}' for k in range(options.cars)] if options.cars > 1 else ['']
        self._tolerated = setup.user_code.tolerated
        self.cars = [self._car(setup, name, number) for number, name in enumerate(namespaces)]
        for car in self.cars:
            car.distance = car.simulator.values['distance'] or inf
        first = self.cars[0]
        distance = first.simulator.values['distance']
        self.display = display(quiet=options.quiet, distance=distance)
        first.show = self.display.show
        return [car.simulator for car in self.cars]

    def _car(self, setup: Setup, namespace: str, number: int) -> Car:
        options, road, user_code = setup.options, setup.road, setup.user_code
        car = Car(namespace, self._controller(setup, namespace))
        car.simulator = setup.engine.simulator(  # type: ignore[assignment]
            road=road,
            distance=_DISTANCE,
            keeps_clock=number == 0,
            on_step=car.on_step,
            model=user_code.model or bikeFE,
            namespace=namespace,
            given=given(
                distance=options.distance,
                laps=options.laps,
                road=road.name if road else None,
                realtime_factor=options.realtime_factor,
                # Each car has its own noise.
                seed=(options.seed or 0) + number if number else options.seed,
                integrator=options.integrator,
                dynamics=options.dynamics,
                clock=options.clock,
                refuse_motor_above=NO_LIMIT if user_code.controller else None,
            ),
        )
        return car

    def _controller(self, setup: Setup, namespace: str) -> Callable[[], float]:
        """Add a controller unless it is left out; return a function for the speed to hold [m/s]."""
        options, user_controller = setup.options, setup.user_code.controller
        if options.no_controller:
            speed = SPEED_REFERENCE if options.speed is None else options.speed
            return lambda: speed
        controller = setup.engine.controller(
            UserController(user_controller) if user_controller else None,
            given(
                speed_reference=options.speed,
                acceleration_limit=options.acceleration_limit,
                controller_type=options.controller_type,
                **_gains(options),
            ),
            acceleration_limit=NO_LIMIT if user_controller else ACCELERATION_LIMIT,
            namespace=namespace,
        )
        if user_controller:
            named = _gains(options)
            from barc_sim.lab.check.code import LocalCode  # noqa: PLC0415 (slow: only where needed)
            from barc_sim.lab.check.judging import Settings, gains_used  # noqa: PLC0415

            settings = Settings(kp=named.get('kp'), ki=named.get('ki'), kd=named.get('kd'))
            gains = gains_used(LocalCode(setup.user_code), settings)
            limit = controller.values['acceleration_limit']
            limited = 'without a limit' if limit >= NO_LIMIT else f'limited to {limit:g} m/s²'
            self._driven_with = f'{gains}, {limited}'
        return lambda: float(controller.values['speed_reference'])

    def spin(self, stop: StopSignals) -> None:
        """Spin until the run is finished or `stop` is requested; a car can fail to arrive."""
        super().spin(stop)
        failures = [
            f'{car.name}: {car.failure}' if car.name else car.failure
            for car in self.cars
            if car.failure
        ]
        if failures:
            self.fail(f'{"; ".join(failures)}: the run has ended')

    def print_result(self) -> None:
        """Print the table of speed errors, and what a user's code drove with."""
        if self._driven_with:
            print(f'controller  {self._driven_with}')  # noqa: T201
        if self._tolerated:
            print(f'tolerated   {"; ".join(self._tolerated)}')  # noqa: T201
        summaries = {name: lap for car in self.cars for name, lap in car.summaries().items()}
        if len(self.cars) > 1:
            print_summaries('car', summaries, self.slipped)
        elif len(summaries) > 1:
            print_summaries('lap', summaries, self.slipped)
        else:
            print_summary(next(iter(summaries.values())), self.slipped)


def _gains(options: Namespace) -> dict[str, float]:
    """Return the gains that the command line gives, by name.

    Raises
    ------
    UserError
        if the controller has no such gain.
    """
    kind = options.controller_type or DEFAULT_TYPE
    named = {name: getattr(options, name) for name in PID.gains}
    gains = {name: value for name, value in named.items() if value is not None}
    gains |= dict(options.gain)
    for name, value in gains.items():
        if name not in TYPES[kind].gains:
            raise UserError(
                f'{name} = {value:g}: the controller {kind} has no such gain; expected one of '
                f'{", ".join(TYPES[kind].gains)}'
            )
    return gains


def _check_no_options_for_controller(options: Namespace) -> None:
    given = {name: getattr(options, name) for name in (*PID.gains, 'controller')}
    given['acceleration-limit'] = options.acceleration_limit
    given['controller-type'] = options.controller_type
    given |= {f'gain {name}': value for name, value in options.gain}
    check_left_out('controller', given)


class Car:
    """A simulator, the laps of its car, and whether that still gets on."""

    simulator: VehicleSimulator
    distance = inf  #: [m] of the run's end

    def __init__(self, name: str, reference: Callable[[], float]) -> None:
        """Begin without a state; `reference` returns the speed to hold [m/s]."""
        self.name = name
        self._reference = reference
        self._laps = Laps()
        self._missed = [0]  # deadlines, before each lap
        self._progress = Progress(inf)
        self.show: Callable[[Status], None] | None = None  #: shows a state in the terminal

    def on_step(self, t: float, seen: Observation) -> None:
        """Add the state, `t` [s] after the start of its lap, to the lap, and show it.

        The run of a car that does not get on ends.
        """
        if t == 0.0:
            self._progress = Progress(self.distance)
        x, speed, reference = seen.true.x, seen.true.v_x, self._reference()
        lap = self._laps.add(t, x, seen.true.y, speed, reference, seen.theta_deg)
        if lap == len(self._missed):
            self._missed.append(self.simulator.stepper.missed)
        if self._progress.add(t, x, speed, reference):
            self.simulator.stepper.end()
        if self.show:
            self.show(CruiseStatus(t, x, speed, reference - speed, seen.theta_deg, lap))

    @property
    def failure(self) -> str:
        """What the car did that never arrives; empty for others."""
        return self._progress.failure

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
