"""Test drives with motor and servo held, to compare integrators; most have a closed form."""

from __future__ import annotations

from math import atanh, cos, inf, log, pi, radians, sin, sinh, sqrt
from typing import TYPE_CHECKING, NamedTuple

from barc_sim.vehicle.bike_model import Command, State, Vehicle, slip_angle
from barc_sim.vehicle.road import Road

if TYPE_CHECKING:
    from collections.abc import Callable

_LAB = Road.lab()


class ReferenceDrive(NamedTuple):
    """A test drive of the bicycles named in `models`.

    Examples
    --------
    >>> circle = REFERENCE_DRIVES[0]
    >>> circle.name, circle.duration, circle.held.servo
    ('circle', 4.0, 0.4)
    """

    name: str
    text: str
    start: State
    held: Command
    grade: Callable[[float], float]  #: distance along the road [m] to incline [rad]
    vehicle: Vehicle
    duration: float  #: [s]
    models: tuple[str, ...] = ('kinematic', 'dynamic')
    exact: Callable[[ReferenceDrive], tuple[float, float]] | None = None  #: x and y [m] at the end


def _lab(x: float) -> float:
    return radians(_LAB.grade_deg(x))


def _circle(test_drive: ReferenceDrive) -> tuple[float, float]:
    """Return where a circle at constant speed ends."""
    beta = slip_angle(test_drive.held.servo)
    radius = test_drive.vehicle.l_r / sin(beta)
    angle = test_drive.start.v * test_drive.duration / radius
    return radius * (sin(angle + beta) - sin(beta)), radius * (cos(beta) - cos(angle + beta))


def _descent(test_drive: ReferenceDrive) -> tuple[float, float]:
    """Return how far a car rolls that slows down to where drag and friction balance gravity."""
    vehicle = test_drive.vehicle
    pull = -vehicle.mass * vehicle.gravity * sin(test_drive.grade(0.0)) - vehicle.friction
    terminal = sqrt(pull / vehicle.air_drag_coeff)
    rate = sqrt(pull * vehicle.air_drag_coeff) / vehicle.mass
    begin = atanh(terminal / test_drive.start.v)
    return terminal / rate * log(sinh(begin + rate * test_drive.duration) / sinh(begin)), 0.0


def _stretches(test_drive: ReferenceDrive) -> tuple[float, float]:
    """Return how far a car without drag comes on stretches of constant grade."""
    vehicle, left = test_drive.vehicle, test_drive.duration
    x, _, _, v = test_drive.start
    for end in (*_LAB.starts[1:], inf):
        a = test_drive.held.motor - vehicle.gravity * sin(_lab(x)) - vehicle.friction / vehicle.mass
        time = 2.0 * (end - x) / (v + sqrt(v * v + 2.0 * a * (end - x))) if end < inf else inf
        if time > left:
            break
        x, v, left = end, v + a * time, left - time
    return x + left * (v + 0.5 * a * left), 0.0


REFERENCE_DRIVES = (
    ReferenceDrive(
        name='circle',
        text='15 m/s, 0.4 rad',
        start=State(v=15.0),
        held=Command(0.0, 0.4),
        grade=lambda _: 0.0,
        vehicle=Vehicle(air_drag_coeff=0.0, friction=0.0),
        duration=4.0,
        models=('kinematic',),
        exact=_circle,
    ),
    ReferenceDrive(
        name='step steer',
        text='20 m/s, 0.05 rad',
        start=State(v=20.0),
        held=Command(0.0, 0.05),
        grade=lambda _: 0.0,
        vehicle=Vehicle(),
        duration=4.0,
        models=('dynamic',),
    ),
    ReferenceDrive(
        name='descent',
        text='30° down, strong drag',
        start=State(v=20.0),
        held=Command(),
        grade=lambda _: radians(-30.0),
        vehicle=Vehicle(mass=1000.0, air_drag_coeff=200.0, friction=50.0),
        duration=2.0,
        exact=_descent,
    ),
    ReferenceDrive(
        name='hills',
        text='smooth, ±10°, 0.03 rad',
        start=State(v=10.0),
        held=Command(0.5, 0.03),
        grade=lambda x: radians(10.0) * sin(pi * x / 20.0),
        vehicle=Vehicle(),
        duration=6.0,
    ),
    ReferenceDrive(
        name="lab's road",
        text='its grade jumps',
        start=State(v=8.0),
        held=Command(3.0),
        grade=_lab,
        vehicle=Vehicle(air_drag_coeff=0.0),
        duration=8.0,
        exact=_stretches,
    ),
)
