"""The fields of a run's messages, from the records of simulation and control."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from barc_sim.control.pid import PID
from barc_sim.simulation.log import CONTROLLER_STATE, PID_STATE

if TYPE_CHECKING:
    from barc_sim.control.controller import Controller
    from barc_sim.vehicle.bike_model import Input
    from barc_sim.vehicle.plant import Observation


def state(seen: Observation) -> dict[str, float]:
    """Return the state as measured.

    Examples
    --------
    >>> from barc_sim.vehicle.plant import Plant
    >>> [*state(Plant().observe())]
    ['x', 'y', 'psi', 'v_x', 'v_y', 'psi_dot']
    """
    x, y, psi, v_x, v_y, psi_dot = seen.measured
    return {'x': x, 'y': y, 'psi': psi, 'v_x': v_x, 'v_y': v_y, 'psi_dot': psi_dot}


def state_error(seen: Observation) -> dict[str, float]:
    """Return the measurement's error.

    Examples
    --------
    >>> from barc_sim.vehicle.plant import Plant
    >>> [*state_error(Plant().observe())]
    ['s', 'ey', 'epsi', 'v_x', 'v_y', 'psi_dot']
    """
    s, ey, epsi, v_x, v_y, psi_dot = seen.error
    return {'s': s, 'ey': ey, 'epsi': epsi, 'v_x': v_x, 'v_y': v_y, 'psi_dot': psi_dot}


def environment(seen: Observation) -> dict[str, float]:
    """Return the forces of road and air, with the incline.

    Examples
    --------
    >>> from barc_sim.vehicle.plant import Plant
    >>> environment(Plant().observe())['theta']
    0.0
    """
    friction, drag, gravity = seen.forces
    return {
        'theta': seen.theta_deg,
        'elevation': seen.elevation,
        'friction': friction,
        'drag': drag,
        'gravity': gravity,
    }


def command(given: Input) -> dict[str, float]:
    """Return a command.

    Examples
    --------
    >>> from barc_sim.vehicle.bike_model import Input
    >>> command(Input(motor=2.0))
    {'motor': 2.0, 'servo': 0.0}
    """
    return {'motor': given.motor, 'servo': given.servo}


def controller_topic(controller: Controller) -> str:
    """Return the topic of what `controller` computes: PIDs have one of their own.

    Examples
    --------
    >>> from barc_sim import LQR, PID
    >>> controller_topic(PID()), controller_topic(LQR())
    ('pid_state', 'controller_state')
    """
    return PID_STATE if controller.terms.keys() == PID.terms.keys() else CONTROLLER_STATE


def controller_state(
    controller: Controller, reference: float, measurement: float, output: float
) -> dict[str, Any]:
    """Return what `controller` computed in its latest call."""
    terms = {name: getattr(controller, name) for name in controller.terms}
    fields = {
        'reference': reference,
        'measurement': measurement,
        'error': reference - measurement,
        'output': output,
        'saturated': controller.saturated,
    }
    if terms.keys() == PID.terms.keys():
        return fields | terms
    return fields | {'names': list(terms), 'values': list(terms.values())}
