"""What a run produced, as NumPy arrays."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Floats = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False)
class Log:
    """One row per state `k` of a run; every array has shape `(n,)`, SI units, radians.

    A quantity that the run did not have (no controller in teleoperation, no command that answered
    state `k`) is NaN.
    """

    t: Floats  #: [s] since the first state
    # As measured (`z_vhcl`): true state plus measurement error.
    x: Floats  #: [m] along the road's surface
    y: Floats  #: [m] to the left
    psi: Floats  #: [rad] heading
    v_x: Floats  #: [m/s] along the vehicle
    v_y: Floats  #: [m/s] to the vehicle's left
    psi_dot: Floats  #: [rad/s] yaw rate
    # Measured minus true (`ez_vhcl`), in the vehicle's frame.
    e_s: Floats  #: [m] along
    e_ey: Floats  #: [m] across
    e_epsi: Floats  #: [rad]
    e_v_x: Floats  #: [m/s]
    e_v_y: Floats  #: [m/s]
    e_psi_dot: Floats  #: [rad/s]
    # The command that answers state k (`ecu`), and whether it came too late to be used.
    motor: Floats  #: [m/s²]
    servo: Floats  #: [rad]
    missed: NDArray[np.bool_]  #: state k's command was not there at its deadline
    # What road and air do (`environment`).
    theta_deg: Floats  #: [deg] incline
    elevation: Floats  #: [m]
    friction: Floats  #: [N]
    drag: Floats  #: [N]
    gravity: Floats  #: [N]
    # The controller (`pid_state`).
    reference: Floats  #: [m/s]
    proportional: Floats  #: [m/s²]
    integral: Floats  #: [m/s²]
    derivative: Floats  #: [m/s²]
    saturated: NDArray[np.bool_]

    def __post_init__(self) -> None:
        """Raise ValueError unless every array has one dimension and as many elements as `t`."""
        expected = (np.size(self.t),)
        for field in fields(self):
            shape = np.shape(getattr(self, field.name))
            if shape != expected:
                raise ValueError(f'{field.name} has shape {shape}, expected {expected}')

    def __len__(self) -> int:
        """Return the number of states."""
        return len(self.t)

    @property
    def speed(self) -> Floats:
        """True speed along the vehicle's axis [m/s], shape `(n,)`."""
        return self.v_x - self.e_v_x

    @property
    def distance(self) -> Floats:
        """True position along the road's surface [m], shape `(n,)`.

        `e_s` and `e_ey` are in the frame of the true heading.
        """
        heading = self.psi - self.e_epsi
        return self.x - (self.e_s * np.cos(heading) - self.e_ey * np.sin(heading))

    @property
    def across(self) -> Floats:
        """True position to the left of the road's axis [m], shape `(n,)`."""
        heading = self.psi - self.e_epsi
        return self.y - (self.e_s * np.sin(heading) + self.e_ey * np.cos(heading))

    @property
    def speed_error(self) -> Floats:
        """Reference minus true speed [m/s], shape `(n,)`."""
        return self.reference - self.speed
