"""The loops without ROS: cruise control, and a list of driver inputs."""

from __future__ import annotations

from typing import TYPE_CHECKING

from hand_drive import drive_by_hand

from barc_sim.control.driver import Driver, DriverInput, DriverLimits
from barc_sim.control.speed import PID, speed_controller
from barc_sim.simulation.closed_loop import closed_loop
from barc_sim.vehicle.bicycles import LateralParameters
from barc_sim.vehicle.bike_model import BicycleState, Vehicle

# The only names of the package that the golden figures use, but for the command line.
from barc_sim.vehicle.plant import Actuator, NoiseLevels, Plant
from barc_sim.vehicle.road import Road

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from barc_sim.simulation.log import Log

#: From a standstill: throttle, curves, coasting, brake, reverse, and inputs out of range. Each
#: row: time [s], `linear.x`, `angular.z`, and the brake, the opposite of `linear.z`.
_INPUTS = [
    *((0.05 * k, 1.0, 0.0, 0.0) for k in range(30)),
    (1.5, 0.75, 1.0, 0.0),
    (1.83, 0.75, 1.0, 0.0),
    (2.21, 0.5, -0.625, 0.0),
    (2.6, 0.5, -0.625, 0.0),
    (2.611, 1.0, 0.0, 0.0),
    (4.0, -0.5, 0.25, 0.0),  # the last one was stale meanwhile
    (4.4, -0.5, 0.25, 0.0),
    (4.8, -3.0, 0.25, 0.0),
    (5.0, 0.0, 0.0, 0.3125),  # holds until there is another
    (7.0, -1.0, -0.5, 0.0),
    *((7.0 + 0.07 * k, -1.0, -0.5, 0.0) for k in range(1, 20)),
    (8.5, 1.0, 2.0, -1.0),
    (8.9, 1.0, 2.0, 0.0),
    (9.3, 1.0, -2.0, 0.0),
    (9.7, 0.0, 0.0, 0.0),
]
_NOISE = NoiseLevels(0.1, 0.05, 0.01, 0.05, 0.02, 0.01)
_MOTOR = Actuator(delay=0.03, lag=0.08, rate=60.0, limit=6.5)
_SERVO = Actuator(delay=0.05, lag=0.1, rate=0.5, limit=0.125)
_HILLS = Road((-5.0, 7.5, 31.0, 33.0, 70.0), (2.5, -4.0, 12.25, 0.125, -20.0))
_STEEP = Road((-30.0, -10.0, 0.0, 2.0), (-15.0, 10.0, 45.0, 60.0))
_VEHICLE = Vehicle(mass=1500.0, air_drag_coeff=0.4, friction=150.0, l_f=1.1, l_r=1.7, gravity=9.81)
_LATERAL = LateralParameters(yaw_inertia=3200.0, front_stiffness=90e3)


def _by_hand(plant: Plant | None = None, limits: DriverLimits | None = None) -> Log:
    inputs = [(t, DriverInput(*shares)) for t, *shares in _INPUTS]
    return drive_by_hand(inputs, 11.0, plant=plant, driver=Driver(limits))


def _rolling_back(speed: float, pid: PID | None = None) -> Log:
    return closed_loop(
        _at(BicycleState(x=1.0, v=3.0), _STEEP), pid, speed_reference=speed, max_duration=8.0
    )


def _at(state: BicycleState, road: Road) -> Plant:
    plant = Plant(road=road)
    plant.state = state
    return plant


def _flat(**options: object) -> Plant:
    return Plant(road=Road.flat(), **options)  # type: ignore[arg-type]


LOOPS: dict[str, Callable[[], Log]] = {
    'rollout_default': closed_loop,
    'rollout_noise': lambda: closed_loop(Plant(noise=_NOISE, seed=3)),
    'rollout_motor': lambda: closed_loop(Plant(motor=_MOTOR)),
    'rollout_rk4': lambda: closed_loop(Plant(integrator='rk4')),
    'rollout_rk4_motor': lambda: closed_loop(Plant(integrator='rk4', motor=_MOTOR)),
    'rollout_dynamic': lambda: closed_loop(Plant(dynamics='dynamic')),
    'rollout_gains': lambda: closed_loop(
        controller=speed_controller(4.0, 3.0, 0.5, limit=5.5), speed_reference=11.5
    ),
    'rollout_proportional': lambda: closed_loop(controller=PID(2.0, 0.0, 0.0)),
    'rollout_vehicle': lambda: closed_loop(Plant(vehicle=_VEHICLE, ts=0.01)),
    'rollout_odd_step': lambda: closed_loop(Plant(ts=1.0 / 30.0)),
    'rollout_hills': lambda: closed_loop(Plant(road=_HILLS)),
    'rollout_held_on_a_hill': lambda: _rolling_back(0.0),
    'rollout_rolling_back': lambda: _rolling_back(0.0, PID(0.5, 0.1, 0.01)),
    'rollout_reversing': lambda: _rolling_back(-4.0),
    'drive_default': _by_hand,
    'drive_noise': lambda: _by_hand(_flat(noise=_NOISE, seed=5)),
    'drive_rk4': lambda: _by_hand(_flat(integrator='rk4')),
    'drive_dynamic': lambda: _by_hand(_flat(dynamics='dynamic')),
    'drive_dynamic_rk4': lambda: _by_hand(
        _flat(dynamics='dynamic', integrator='rk4', vehicle=_VEHICLE, lateral=_LATERAL)
    ),
    'drive_actuators': lambda: _by_hand(_flat(motor=_MOTOR, servo=_SERVO)),
    'drive_actuators_rk4': lambda: _by_hand(
        _flat(motor=_MOTOR, servo=_SERVO, integrator='rk4', dynamics='dynamic')
    ),
    'drive_hills': lambda: _by_hand(Plant(road=_HILLS)),
    'drive_limits': lambda: _by_hand(
        limits=DriverLimits(
            2.0, 5.0, speed=4.0, steering=0.2, steering_rate=0.3, self_centring=False
        )
    ),
}


def columns(name: str) -> dict[str, Sequence[float]]:
    """Run the loop called `name`; return what it logged: a value for each state, by quantity."""
    log = LOOPS[name]()
    return {name: column.tolist() for name, column in log.columns().items()}
