"""The sensor: the true motion plus measurement noise."""

from __future__ import annotations

from math import cos, sin
from random import Random
from typing import NamedTuple

from barc_sim.vehicle.bike_model import Motion


class NoiseLevels(NamedTuple):
    """The standard deviation of each measured signal, in the vehicle's true frame."""

    s: float = 0.0  #: [m] position along
    ey: float = 0.0  #: [m] position across
    epsi: float = 0.0  #: [rad] heading
    v_x: float = 0.0  #: [m/s]
    v_y: float = 0.0  #: [m/s]
    psi_dot: float = 0.0  #: [rad/s] yaw rate


class MeasurementError(NamedTuple):
    """Measured minus true, of each signal of `NoiseLevels`."""

    s: float = 0.0
    ey: float = 0.0
    epsi: float = 0.0
    v_x: float = 0.0
    v_y: float = 0.0
    psi_dot: float = 0.0


#: The signals by the names of their fields in `NoiseLevels` and `MeasurementError`.
SIGNALS = {
    's': 'position along [m]',
    'ey': 'position across [m]',
    'epsi': 'heading [rad]',
    'v_x': 'v_x [m/s]',
    'v_y': 'v_y [m/s]',
    'psi_dot': 'yaw rate [rad/s]',
}
_NO_ERROR = MeasurementError()


class Sensor:
    """Adds white Gaussian noise; the same seed gives the same errors.

    The generator is Python's Mersenne Twister, whose sequence is the same in every version, and
    every measurement draws six numbers: the noise of one signal does not depend on whether another
    has any.

    Attributes
    ----------
    noise
        The standard deviations.

    Examples
    --------
    >>> true = Motion(x=0.0, y=0.0, psi=0.0, v_x=8.0, v_y=0.0, psi_dot=0.0)
    >>> measured, error = Sensor(NoiseLevels(v_x=0.05), seed=1).measure(true)
    >>> measured.v_x - error.v_x == true.v_x
    True
    """

    def __init__(self, noise: NoiseLevels | None = None, seed: int = 0) -> None:
        """Measure with these standard deviations, zero unless given."""
        self.noise = noise or NoiseLevels()
        self._random = Random(seed)  # noqa: S311 (a simulation, not a secret)

    @property
    def is_noisy(self) -> bool:
        """Whether any signal has noise."""
        return any(self.noise)

    def measure(self, true: Motion) -> tuple[Motion, MeasurementError]:
        """Return the motion as measured, and its error: measured minus true."""
        if not any(self.noise):
            return true, _NO_ERROR
        gauss = self._random.gauss
        error = MeasurementError(*[sigma * gauss(0.0, 1.0) for sigma in self.noise])
        cos_psi, sin_psi = cos(true.psi), sin(true.psi)
        x = true.x + error.s * cos_psi + error.ey * -sin_psi
        y = true.y + error.s * sin_psi + error.ey * cos_psi
        psi = true.psi + error.epsi
        v_x, v_y = true.v_x + error.v_x, true.v_y + error.v_y
        measured = Motion(x, y, psi, v_x, v_y, true.psi_dot + error.psi_dot)
        return measured, error
