"""The run of `barc acc`: the cruise control holds a speed over the hills, or on a track.

It reads from top to bottom: make the nodes, add them to one executor, spin, close.
"""

from __future__ import annotations

from math import inf
from typing import TYPE_CHECKING, Any

from barc_sim.control.cruise_control import PROFILE
from barc_sim.control.lane import LANE
from barc_sim.control.speed import ACCELERATION_LIMIT, KD, KI, KP, NO_LIMIT, PID
from barc_sim.nodes.controller import CruiseController
from barc_sim.runs.car_monitor import CarMonitor
from barc_sim.runs.composition import Run
from barc_sim.runs.engine import start_engine
from barc_sim.runs.inputs import gains
from barc_sim.runs.report import late, print_line, print_report
from barc_sim.runs.terminal import Display, print_summaries, print_summary, print_track_laps
from barc_sim.runs.views import add_views
from barc_sim.simulation.closed_loop import check_ahead
from barc_sim.simulation.scenario import Scenario

if TYPE_CHECKING:
    from argparse import Namespace

    from barc_sim.cli.process import StopSignals
    from barc_sim.lab.user_code.code import UserCode
    from barc_sim.nodes.simulator import VehicleSimulator
    from barc_sim.runs.inputs import RunInputs
    from barc_sim.simulation.metrics import Summary


def run_nodes(options: Namespace, inputs: RunInputs, stop: StopSignals) -> int:
    """Run the nodes to the end of the road, or until `stop`; return the exit code.

    UserError: a parameter or a ROS argument cannot be used; no bag is left then.
    """
    with start_engine(options) as carrier, Run(options, inputs, carrier) as run:
        cars = [add_car(run, number) for number in range(options.cars)]
        if not options.quiet:
            run.display = Display(cars[0].simulator.stepper.distance)
            cars[0].display = run.display
        print_line(options, f'engine     {carrier.name}')
        add_views(run)
        run.prepare()
        stop.then(run.finish)

        with carrier.new_executor() as executor:
            for node in run.nodes:
                executor.add_node(node)
            executor.spin_until_future_complete(run.finished)
            run.await_readers(executor)

        failures = [car.failure for car in cars if car.failure]
        if failures:
            run.fail(f'{"; ".join(failures)}: the run has ended')
    return print_report(run, lambda: print_result(run, cars))


def add_car(run: Run, number: int) -> CarMonitor:
    """Add the controller and the simulator of a car to the run; a single car has no namespace.

    UserError: a parameter is out of range, or the topic is in use.
    """
    name = f'car{number + 1}' if run.options.cars > 1 else ''
    controller = None if run.options.no_controller else _add_controller(run, name)
    simulator = _add_simulator(run, name, number)

    distance = simulator.stepper.distance
    if controller and distance < inf and not controller.values['reference']:
        check_ahead(controller.values['speed_reference'], distance)
    return CarMonitor(run, name, controller, simulator)


def _add_controller(run: Run, namespace: str) -> CruiseController:
    options = run.options
    user_code = run.inputs.user_code
    laws = run.inputs.new_laws()

    parameters: dict[str, Any] = {
        'speed_reference': options.speed,
        'reference': options.reference,
        'acceleration_limit': options.acceleration_limit,
        'controller_type': options.controller_type,
        'lane_type': None if laws.lane else options.lane,
    }
    if options.speed_profile:
        lateral, longitudinal = PROFILE
        parameters[lateral.name] = options.speed_profile[0]
        parameters[longitudinal.name] = options.speed_profile[1]
    parameters |= {LANE + gain: value for gain, value in options.lane_gain}
    parameters |= gains(options)

    has_user_law = user_code.controller or user_code.identify
    controller: CruiseController = run.add(
        CruiseController,
        parameters,
        controller=laws.speed,
        track=run.inputs.track,
        lane=laws.lane,
        acceleration_limit=NO_LIMIT if has_user_law else ACCELERATION_LIMIT,
        namespace=namespace,
    )
    return controller


def _add_simulator(run: Run, namespace: str, number: int) -> VehicleSimulator:
    options = run.options
    road = run.inputs.road
    track = run.inputs.track
    user_code = run.inputs.user_code

    parameters = {
        'distance': options.distance,
        'laps': options.laps,
        'road': road.name if road else None,
        'refuse_motor_above': NO_LIMIT if user_code.controller else None,
        **_identified(user_code),
    }
    if number > 0:  # each car has its own noise
        parameters['seed'] = (options.seed or 0) + number

    return run.add_simulator(
        parameters,
        road=road,
        track=track,
        distance=0.0 if track else Scenario.distance,
        keeps_clock=number == 0,
        namespace=namespace,
    )


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


def print_result(run: Run, cars: list[CarMonitor]) -> None:
    """Print the table of speed errors, and the gains and limit of a user's controller."""
    user_code = run.inputs.user_code
    controller = cars[0].controller
    if user_code.controller and controller:
        print(f'controller  {_driven_with(run.options, user_code, controller)}')  # noqa: T201
    if user_code.tolerated:
        print(f'tolerated   {"; ".join(user_code.tolerated)}')  # noqa: T201
    if user_code.identify:
        return  # its commands hold no speed

    if cars[0].simulator.track:
        print_track_laps({car.name: car.track_laps for car in cars}, late(run))
        return

    summaries: dict[str, Summary] = {}
    for car in cars:
        summaries |= car.summaries()
    if len(summaries) > 1:
        print_summaries('car' if len(cars) > 1 else 'lap', summaries, late(run))
    else:
        [summary] = summaries.values()
        print_summary(summary, late(run))


def _driven_with(options: Namespace, user_code: UserCode, controller: CruiseController) -> str:
    """Return the gains and the limit of a user's controller."""
    from barc_sim.lab.files import ChosenGains  # noqa: PLC0415 (slow)

    controller_gains = user_code.gains or ChosenGains(KP, KI, KD, 'barc_sim')
    overrides = gains(options)
    if overrides:
        is_whole = len(overrides) == len(PID.gains)
        rest = '' if is_whole else f', the others from {controller_gains.origin}'
        controller_gains = controller_gains._replace(**overrides, origin=f'the command line{rest}')

    limit = controller.values['acceleration_limit']
    limited = 'without a limit' if limit >= NO_LIMIT else f'limited to {limit:g} m/s²'
    return f'{controller_gains}, {limited}'
