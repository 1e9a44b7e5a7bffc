"""The cruise-control run: the PID holds a speed over the hills, or on a track.

It reads from top to bottom: make the nodes, add them to one executor, spin, close.
"""

from __future__ import annotations

from math import inf
from typing import TYPE_CHECKING

from barc_sim.control.cruise_control import PROFILE
from barc_sim.control.lane import LANE
from barc_sim.control.speed import ACCELERATION_LIMIT, NO_LIMIT
from barc_sim.nodes.controller import CruiseController
from barc_sim.runs.car import Car, print_result
from barc_sim.runs.composition import Run, carrier
from barc_sim.runs.inputs import gains
from barc_sim.runs.terminal import Display
from barc_sim.simulation.closed_loop import check_ahead

if TYPE_CHECKING:
    from argparse import Namespace

    from barc_sim.cli.process import StopSignals
    from barc_sim.lab.user_code.code import UserCode
    from barc_sim.runs.inputs import Inputs

#: [m] The lab's road ends there.
_DISTANCE = 180.0


def drive(options: Namespace, inputs: Inputs, stop: StopSignals) -> int:
    """Drive to the end of the road, or until `stop`; return the exit code.

    UserError: a parameter or a ROS argument cannot be used; no bag is left then.
    """
    with carrier(options) as new_executor, Run(options, inputs, stop) as run:
        cars = [add_car(run, number) for number in range(options.cars)]
        if not options.quiet:
            cars[0].display = Display(cars[0].simulator.stepper.distance)
        run.show(cars[0].display)

        with new_executor() as executor:
            run.spin(executor)

        if failures := [failure for car in cars if (failure := car.failure)]:
            run.fail(f'{"; ".join(failures)}: the run has ended')
    return run.end(lambda: print_result(run, cars))


def add_car(run: Run, number: int) -> Car:
    """Add the controller and the simulator of a car to the run; one car alone has no namespace.

    UserError: a parameter is out of range, or the topic is taken.
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
        distance=0.0 if track else _DISTANCE,
        keeps_clock=number == 0,
        namespace=name,
    )
    distance = simulator.stepper.distance
    if controller and distance < inf and not controller.values['reference']:
        check_ahead(controller.values['speed_reference'], distance)
    return Car(run, name, controller, simulator)


def _identified(user_code: UserCode) -> dict[str, float]:
    """Return the parameters of the car that a student identifies; none without `identify.py`."""
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
