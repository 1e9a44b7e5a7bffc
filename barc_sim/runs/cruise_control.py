"""The cruise-control run: the PID holds a speed over the hills."""

from __future__ import annotations

from typing import TYPE_CHECKING

from barc_sim.control.pid import PID, SPEED_REFERENCE
from barc_sim.control.types import DEFAULT_TYPE, TYPES
from barc_sim.errors import UserError
from barc_sim.lab.user_code.adapters import UserController
from barc_sim.nodes.controller import CruiseController
from barc_sim.nodes.simulator.node import VehicleSimulator
from barc_sim.runs.composition import Run, conduct, overrides
from barc_sim.runs.terminal.display import display, print_summaries, print_summary
from barc_sim.simulation.metrics import SpeedErrors
from barc_sim.vehicle.bike_model import bikeFE

if TYPE_CHECKING:
    from argparse import Namespace
    from collections.abc import Callable

    from barc_sim.cli.signals import StopSignals
    from barc_sim.simulation.metrics import Summary
    from barc_sim.vehicle.plant import Observation

#: [m] The lab's road ends there.
_DISTANCE = 180.0


def cruise_control(
    options: Namespace, argv: list[str], ros_args: list[str], stop: StopSignals
) -> int:
    """Drive until the distance is reached or `stop` is requested; return the exit code.

    Raises
    ------
    UserError
        where an option or a ROS argument can't be used; nothing is left behind then.
    """
    return conduct(
        lambda user_code, printed: CruiseControl(options, argv, user_code, printed),
        options,
        ros_args,
        stop,
    )


class CruiseControl(Run):
    """Recorder, and of each car controller, unless another takes its place, and simulator."""

    def compose(self, options: Namespace) -> list[VehicleSimulator]:
        """Return the simulators, each of a car on a road of its own.

        Raises
        ------
        UserError
            where an option is for a controller that the run does not have.
        """
        if options.controller_type and self.user_code.controller:
            raise UserError(
                f"--controller-type {options.controller_type} names a controller of barc_sim's, "
                'and --lab or --controller gives another: give one of the two only'
            )
        if options.no_controller:
            _check_that_none_is_told(options)
        namespaces = [f'car{number + 1}' for number in range(options.cars)]
        # A car that is alone needs none.
        self.cars = [
            self._car(options, name, number)
            for number, name in enumerate(namespaces if options.cars > 1 else [''])
        ]
        first = self.cars[0]
        distance = first.simulator.get_parameter('distance').value
        self._display = display(distance, quiet=options.quiet)
        self._printed.show_with(self._display.say)
        first.show = self._display.show
        return [car.simulator for car in self.cars]

    def _car(self, options: Namespace, namespace: str, number: int) -> Car:
        car = Car(namespace, self._controller(options, namespace))
        car.simulator = self.add(
            VehicleSimulator(
                distance=_DISTANCE,
                keeps_clock=number == 0,
                on_step=car.on_step,
                model=self.user_code.model or bikeFE,
                namespace=namespace,
                parameter_overrides=overrides(
                    distance=options.distance,
                    road=options.road,
                    realtime_factor=options.realtime_factor,
                    # Each car has noise of its own.
                    seed=(options.seed or 0) + number if number else options.seed,
                    integrator=options.integrator,
                    dynamics=options.dynamics,
                    clock=options.clock,
                ),
            )
        )
        return car

    def _controller(self, options: Namespace, namespace: str) -> Callable[[], float]:
        """Add a controller, or none; return what tells the speed to hold [m/s]."""
        if options.no_controller:
            speed = SPEED_REFERENCE if options.speed is None else options.speed
            return lambda: speed
        controller: CruiseController = self.add(
            CruiseController(
                controller=UserController(self.user_code.controller)
                if self.user_code.controller
                else None,
                namespace=namespace,
                parameter_overrides=overrides(
                    speed_reference=options.speed,
                    controller_type=options.controller_type,
                    **_gains(options),
                ),
            )
        )
        return lambda: controller.speed_reference

    def close_display(self) -> None:
        """Leave the terminal's line in order."""
        self._display.close()

    def print_result(self) -> None:
        """Print the table of errors."""
        if len(self.cars) == 1:
            (car,) = self.cars
            print_summary(car.summary(), self.slipped)
        else:
            print_summaries({car.name: car.summary() for car in self.cars}, self.slipped)


def _gains(options: Namespace) -> dict[str, float]:
    """Return the gains that the command line gives, by name.

    Raises
    ------
    UserError
        where the controller has no such gain.
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


def _check_that_none_is_told(options: Namespace) -> None:
    given = {name: getattr(options, name) for name in (*PID.gains, 'controller')}
    given['controller-type'] = options.controller_type
    given |= {f'gain {name}': value for name, value in options.gain}
    for name, value in given.items():
        if value is not None:
            raise UserError(
                f'--{name} {value} is for the controller that --no-controller leaves out: give one '
                'of the two only'
            )


class Car:
    """A simulator, and how well it is driven."""

    simulator: VehicleSimulator

    def __init__(self, name: str, reference: Callable[[], float]) -> None:
        """Not yet driven; `reference` tells the speed to hold [m/s]."""
        self.name = name
        self._reference = reference
        self._errors = SpeedErrors()
        #: Shows a state: its time, distance, speed, speed error and grade.
        self.show: Callable[[float, float, float, float, float], None] = lambda *_: None

    def on_step(self, t: float, seen: Observation) -> None:
        """Count the speed's error, from the start or the latest reset on, and show it."""
        if t == 0.0:
            self._errors = SpeedErrors()
        reference = self._reference()
        self._errors.add(t, seen.true.x, seen.true.v_x, reference, seen.theta_deg)
        self.show(t, seen.true.x, seen.true.v_x, reference - seen.true.v_x, seen.theta_deg)

    def summary(self) -> Summary:
        """Return how well it was driven."""
        return self._errors.summary(self.simulator.missed)
