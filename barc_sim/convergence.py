"""How fast the error of a step falls with its length, for each model and integrator."""

from __future__ import annotations

from math import atanh, cos, hypot, pi, radians, sin, sinh, sqrt, tanh
from math import log as ln
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from barc_sim.bike_model import Input, State, Vehicle, slip_angle
from barc_sim.dynamic_bike import DynamicBicycle
from barc_sim.integrators import INTEGRATORS
from barc_sim.kinematic_bike import KinematicBicycle
from barc_sim.road import Road

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from barc_sim.kinematic_bike import Grade

#: [s] The lab's step, halved again and again.
STEPS = tuple(0.02 / 2**k for k in range(5))
#: [s] That of the solution that stands for the true one where there is no closed form.
FINE = 0.02 / 128
#: [m] What rounding leaves of an error: smaller ones say nothing of the method.
ROUNDING = 1e-11
_FREE = Vehicle(air_drag_coeff=0.0)
_DRAGGED = Vehicle(mass=1000.0, air_drag_coeff=200.0, friction=50.0)


class Manoeuvre(NamedTuple):
    """A drive with motor and servo held."""

    name: str
    text: str
    start: State
    held: Input
    grade: Grade
    vehicle: Vehicle
    duration: float  #: [s]
    models: tuple[str, ...] = ('kinematic', 'dynamic')
    exact: Callable[[Manoeuvre], tuple[float, float]] | None = None  #: x and y [m] at the end


class Study(NamedTuple):
    """The errors of one integrator of one model in one manoeuvre."""

    manoeuvre: str
    text: str
    reference: str
    model: str
    integrator: str
    errors: tuple[float, ...]  #: [m] of the position at the end, for each of `STEPS`
    order: float  #: the slope of the errors; NaN where rounding leaves fewer than two of them


def studies(manoeuvres: tuple[Manoeuvre, ...] | None = None) -> Iterator[Study]:
    """Yield the study of each manoeuvre (`MANOEUVRES`), model and integrator."""
    for manoeuvre in manoeuvres or MANOEUVRES:
        for model in manoeuvre.models:
            if manoeuvre.exact:
                reference, (x, y) = 'closed form', manoeuvre.exact(manoeuvre)
            else:
                end = drive(manoeuvre, model, 'rk4', FINE)
                reference, (x, y) = f'rk4 in steps of {1e3 * FINE:g} ms', end[:2]
            for integrator in INTEGRATORS:
                ends = [drive(manoeuvre, model, integrator, ts) for ts in STEPS]
                errors = tuple(hypot(end.x - x, end.y - y) for end in ends)
                yield Study(
                    manoeuvre.name, manoeuvre.text, reference, model, integrator, errors,
                    order(errors),
                )  # fmt: skip


def drive(manoeuvre: Manoeuvre, model: str, integrator: str, ts: float) -> State:
    """Return the state at the end, in steps of `ts` seconds."""
    bicycle: KinematicBicycle | DynamicBicycle = (
        DynamicBicycle(integrator=integrator)
        if model == 'dynamic'
        else KinematicBicycle(integrator)
    )
    state = manoeuvre.start
    for _ in range(round(manoeuvre.duration / ts)):
        state = bicycle.step(state, manoeuvre.held, manoeuvre.grade, manoeuvre.vehicle, ts)
    return state


def order(errors: tuple[float, ...]) -> float:
    """Return the slope of log error over log step, for errors [m] that belong to `STEPS`."""
    told = [(ts, error) for ts, error in zip(STEPS, errors, strict=True) if error > ROUNDING]
    if len(told) < 2:  # noqa: PLR2004 (a slope's least)
        return float('nan')
    return float(np.polyfit(*np.log(np.array(told)).T, 1)[0])


def _flat(_: float) -> float:
    return 0.0


def _down(_: float) -> float:
    return radians(-30.0)


def _hills(x: float) -> float:
    return radians(10.0) * sin(pi * x / 20.0)


_LAB = Road.lab()


def _lab(x: float) -> float:
    return radians(_LAB.grade_deg(x))


def _circle(manoeuvre: Manoeuvre) -> tuple[float, float]:
    """Return where a circle at constant speed ends."""
    beta = slip_angle(manoeuvre.held.servo)
    radius = manoeuvre.vehicle.l_r / sin(beta)
    angle = manoeuvre.start.v * manoeuvre.duration / radius
    return radius * (sin(angle + beta) - sin(beta)), radius * (cos(beta) - cos(angle + beta))


def _descent(manoeuvre: Manoeuvre) -> tuple[float, float]:
    """Return how far a car rolls that slows down to where drag and friction balance gravity."""
    vehicle = manoeuvre.vehicle
    pull = -vehicle.mass * vehicle.gravity * sin(manoeuvre.grade(0.0)) - vehicle.friction
    terminal = sqrt(pull / vehicle.air_drag_coeff)
    rate = sqrt(pull * vehicle.air_drag_coeff) / vehicle.mass
    begin = atanh(terminal / manoeuvre.start.v)
    return terminal / rate * ln(sinh(begin + rate * manoeuvre.duration) / sinh(begin)), 0.0


def _stretches(manoeuvre: Manoeuvre) -> tuple[float, float]:
    """Return how far a car without drag comes on stretches of constant grade."""
    vehicle, x, v, left = (
        manoeuvre.vehicle,
        manoeuvre.start.x,
        manoeuvre.start.v,
        manoeuvre.duration,
    )
    for end in _LAB.starts[1:]:
        a = manoeuvre.held.motor - vehicle.gravity * sin(_lab(x)) - vehicle.friction / vehicle.mass
        time = 2.0 * (end - x) / (v + sqrt(v * v + 2.0 * a * (end - x)))
        if time > left:
            break
        x, v, left = end, v + a * time, left - time
    return x + left * (v + 0.5 * a * left), 0.0


MANOEUVRES = (
    Manoeuvre(
        'circle', '15 m/s, 0.4 rad', State(v=15.0), Input(0.0, 0.4), _flat,
        _FREE._replace(friction=0.0), 4.0, ('kinematic',), _circle,
    ),
    Manoeuvre(
        'descent', '-30°, strong drag', State(v=20.0), Input(), _down, _DRAGGED, 2.0,
        exact=_descent,
    ),
    Manoeuvre('hills', 'smooth, ±10°', State(v=10.0), Input(0.5), _hills, Vehicle(), 6.0),
    Manoeuvre('step steer', '20 m/s, 0.05 rad', State(v=20.0), Input(1.0, 0.05), _flat, Vehicle(), 4.0),
    Manoeuvre(
        "lab's road", 'its grade jumps', State(v=8.0), Input(3.0), _lab, _FREE, 12.0,
        exact=_stretches,
    ),
)  # fmt: skip
