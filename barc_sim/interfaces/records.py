"""Records of the fields of our messages, without the header.

The laws of vehicle and control take and return them, a log has their fields as columns, and the
nodes publish them. A number can also be an array, with an element for each state.
"""

from __future__ import annotations

from typing import NamedTuple


class VehicleState(NamedTuple):
    """The state on `z_vhcl` (ZDynBkMdl), measured or true: velocities in the vehicle's frame."""

    x: float  #: [m]
    y: float  #: [m]
    psi: float  #: [rad]
    v_x: float  #: [m/s] along the vehicle's axis
    v_y: float  #: [m/s] to the vehicle's left
    psi_dot: float  #: [rad/s]


class MeasurementError(NamedTuple):
    """The measurement error on `ez_vhcl` (EZDynBkMdl), measured minus true."""

    s: float = 0.0  #: [m] along the vehicle's true heading
    ey: float = 0.0  #: [m] to the left of that heading
    epsi: float = 0.0  #: [rad]
    v_x: float = 0.0  #: [m/s]
    v_y: float = 0.0  #: [m/s]
    psi_dot: float = 0.0  #: [rad/s]


class Command(NamedTuple):
    """The command to the actuators on `ecu` (ECU)."""

    motor: float = 0.0  #: [m/s²] acceleration
    servo: float = 0.0  #: [rad] front steering angle, positive to the left


class Surroundings(NamedTuple):
    """The incline, the elevation and the external forces on `environment` (Environment).

    The forces are positive forwards; their sum is F_ext.
    """

    #: [deg] incline of the road, as in the lab's message; the laws in `vehicle` have theta in
    #: radians, and a log names its column `theta_deg`
    theta: float
    elevation: float  #: [m]
    friction: float  #: [N]
    drag: float  #: [N]
    gravity: float  #: [N]


class TrackState(NamedTuple):
    """The position of the car on its track, on `track_vhcl` (TrackState)."""

    s: float  #: [m] along the centre line; it grows over the laps
    e_y: float  #: [m] to the left of the centre line
    e_psi: float  #: [rad] heading minus the heading of the centre line
    curvature: float  #: [1/m] of the centre line there
    width: float  #: [m] of the track there, from edge to edge
    lap: int  #: laps before this one; the car has passed their end, s = k · length
    lap_time: float  #: [s] since the lap began, between two states
