"""Lateral dynamics of the bicycle with linear tyres, in closed form.

After Rajamani, "Vehicle Dynamics and Control", 2nd ed., sections 2.3 and 3.3, where a tyre's
stiffness is half of an axle's here. All of it is of small angles at a constant speed.
"""

from __future__ import annotations

from cmath import sqrt as complex_sqrt
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from barc_sim.vehicle.bike_model import Vehicle


class LateralParameters(NamedTuple):
    """Parameters of the dynamic bicycle beyond `Vehicle`; the defaults understeer mildly."""

    yaw_inertia: float = 4000.0  #: [kg m²] I_z
    front_stiffness: float = 120e3  #: [N/rad] C_f, of the front axle's tyres together
    rear_stiffness: float = 160e3  #: [N/rad] C_r, of the rear axle's
    dynamic_above: float = 3.0  #: [m/s] slower, and in reverse, the car is the kinematic bicycle


Matrix = tuple[tuple[float, float], tuple[float, float]]


def lateral_matrix(vehicle: Vehicle, lateral: LateralParameters, v: float) -> Matrix:
    """Return A of d/dt (v_y, psi_dot) = A (v_y, psi_dot) + B δ, at speed `v` [m/s] above zero.

    Examples
    --------
    >>> from barc_sim import Vehicle
    >>> (a, b), (c, d) = lateral_matrix(Vehicle(), LateralParameters(), 8.0)
    >>> round(a, 2), round(b, 2), round(c, 2), round(d, 2)
    (-17.5, -4.25, 1.88, -19.69)
    """
    m, l_f, l_r = vehicle.mass, vehicle.l_f, vehicle.l_r
    i_z, c_f, c_r, _ = lateral
    moment = l_f * c_f - l_r * c_r
    return (
        (-(c_f + c_r) / (m * v), -v - moment / (m * v)),
        (-moment / (i_z * v), -(l_f**2 * c_f + l_r**2 * c_r) / (i_z * v)),
    )


def eigenvalues(vehicle: Vehicle, lateral: LateralParameters, v: float) -> tuple[complex, complex]:
    """Return the eigenvalues [1/s] of `lateral_matrix`, that of the greater real part first.

    Examples
    --------
    >>> from barc_sim import Vehicle
    >>> slowest, fastest = eigenvalues(Vehicle(), LateralParameters(), 8.0)
    >>> round(slowest.real, 1), round(abs(slowest.imag), 1)
    (-18.6, 2.6)
    """
    (a, b), (c, d) = lateral_matrix(vehicle, lateral, v)
    mean, root = 0.5 * (a + d), complex_sqrt(0.25 * (a - d) ** 2 + b * c)
    return mean + root, mean - root


def understeer_gradient(vehicle: Vehicle, lateral: LateralParameters) -> float:
    """Return K [rad s²/m]: on a circle of radius R the steering is (l_f + l_r)/R + K v²/R.

    It is positive where the car understeers, zero where it is neutral.

    Examples
    --------
    >>> from barc_sim import Vehicle
    >>> round(understeer_gradient(Vehicle(), LateralParameters()), 6)
    0.002083
    """
    load = vehicle.mass / (vehicle.l_f + vehicle.l_r)
    return load * (vehicle.l_r / lateral.front_stiffness - vehicle.l_f / lateral.rear_stiffness)
