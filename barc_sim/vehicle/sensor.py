"""The sensor: the true motion plus measurement noise."""

from __future__ import annotations

from math import cos, log, pi, sin
from random import Random
from typing import TYPE_CHECKING, Annotated, NamedTuple

from barc_sim.vehicle.actuators import in_steps
from barc_sim.vehicle.limits import limited

if TYPE_CHECKING:
    from collections.abc import Callable

    import numpy as np
    from numpy.typing import NDArray

    from barc_sim.vehicle.bike_model import Motion

    Floats = NDArray[np.float64]


@limited
class NoiseLevels(NamedTuple):
    """The standard deviation of each measured signal, in the vehicle's true frame."""

    s: Annotated[float, 'standard deviation of position along [m]', 0.0, 1e3] = 0.0
    ey: Annotated[float, 'standard deviation of position across [m]', 0.0, 1e3] = 0.0
    epsi: Annotated[float, 'standard deviation of heading [rad]', 0.0, 1e3] = 0.0
    v_x: Annotated[float, 'standard deviation of v_x [m/s]', 0.0, 1e3] = 0.0
    v_y: Annotated[float, 'standard deviation of v_y [m/s]', 0.0, 1e3] = 0.0
    psi_dot: Annotated[float, 'standard deviation of yaw rate [rad/s]', 0.0, 1e3] = 0.0


class MeasurementError(NamedTuple):
    """Measured minus true, of each signal of `NoiseLevels`."""

    s: float = 0.0
    ey: float = 0.0
    epsi: float = 0.0
    v_x: float = 0.0
    v_y: float = 0.0
    psi_dot: float = 0.0


_NO_ERROR = MeasurementError()


class Sensor:
    """Measures a motion late, and adds white Gaussian noise; one seed gives the same errors.

    A measurement is that of `delay` seconds ago; between two states, on the line between them.

    The generator is Python's Mersenne Twister, whose sequence is the same in every version, and
    every measurement draws six numbers: the noise of one signal does not depend on whether another
    has any.
    """

    def __init__(
        self,
        noise: NoiseLevels | None = None,
        seed: int = 0,
        *,
        delay: float = 0.0,
        ts: float = 0.02,
    ) -> None:
        """Measure every `ts` seconds with these standard deviations, zero unless given."""
        self.noise = noise or NoiseLevels()
        self.delay, self._ts = delay, ts
        self._past: list[Motion] = []  # from the one that a measurement needs first
        self._seed = seed
        self._random = Random(int(seed))  # noqa: S311 (a simulation, not a secret)

    @property
    def is_noisy(self) -> bool:
        """Whether any signal has noise."""
        return any(self.noise)

    def measure(self, true: Motion) -> tuple[Motion, MeasurementError]:
        """Return the motion as measured, and its error: measured minus true."""
        if self.delay:
            return self._measure_late(true)
        if not self.is_noisy:
            return true, _NO_ERROR
        error = self._draw_one()
        return with_error(true, error, cos(true.psi), sin(true.psi)), error

    def forget(self) -> None:
        """Forget the motion so far: the car is somewhere else."""
        self._past = []

    def _draw_one(self) -> MeasurementError:
        gauss = self._random.gauss
        return MeasurementError(*[sigma * gauss(0.0, 1.0) for sigma in self.noise])

    def _measure_late(self, true: Motion) -> tuple[Motion, MeasurementError]:
        whole, share = in_steps(self.delay, self._ts)
        past = self._past = [*self._past[-whole - 1 :], true]
        older, newer = (past[max(len(past) - k, 0)] for k in (whole + 2, whole + 1))
        seen = newer
        if share:
            pairs = zip(older, newer, strict=True)
            seen = type(true)(*[share * old + (1.0 - share) * new for old, new in pairs])
        if self.is_noisy:
            seen = with_error(seen, self._draw_one(), cos(seen.psi), sin(seen.psi))
        x, y, *others = [now - then for now, then in zip(seen, true, strict=True)]
        along, across = cos(true.psi), sin(true.psi)
        return seen, MeasurementError(x * along + y * across, y * along - x * across, *others)

    def again(self) -> Sensor:
        """Return such a sensor before its first measurement."""
        return Sensor(self.noise, self._seed, delay=self.delay, ts=self._ts)

    def draw(self, n: int) -> Floats:
        """Return the errors of the next `n` measurements, shape `(6, n)`.

        They are those of `measure` to the last bit: the same numbers of the generator, all at
        once, and the transform of two of them to two errors that `Random.gauss` makes. Its
        functions are Python's, as NumPy's differ in the last bit; an error without noise is ±0,
        whose sign NumPy's have right.
        """
        import numpy as np  # noqa: PLC0415 (a sensor alone does not need it)

        words = np.frombuffer(self._random.getrandbits(384 * n).to_bytes(48 * n, 'little'), '<u4')
        high, low = words.reshape(n, 6, 2).transpose(2, 1, 0)

        def uniform(i: int) -> Floats:
            values: Floats = (high[i] >> 5) * 2.0**26 + (low[i] >> 6)  # as Random.random
            return values / 2.0**53

        def exactly(function: Callable[[float], float], values: Floats) -> Floats:
            return np.fromiter(map(function, values.tolist()), np.float64, n)

        errors = np.empty((6, n))
        for i in (0, 2, 4):
            angle = uniform(i) * (2.0 * pi)
            if any(self.noise[i : i + 2]):
                radius = np.sqrt(-2.0 * exactly(log, 1.0 - uniform(i + 1)))
            for j, function, roughly in ((i, cos, np.cos), (i + 1, sin, np.sin)):
                if sigma := self.noise[j]:
                    errors[j] = sigma * (exactly(function, angle) * radius + 0.0)
                else:
                    errors[j] = 0.0 * roughly(angle)
        return errors


def with_error(true: Motion, error: MeasurementError, cos_psi: float, sin_psi: float) -> Motion:
    """Return the motion as measured, of numbers or arrays, with cosine and sine of the heading."""
    return true._replace(
        x=true.x + error.s * cos_psi + error.ey * -sin_psi,
        y=true.y + error.s * sin_psi + error.ey * cos_psi,
        psi=true.psi + error.epsi,
        v_x=true.v_x + error.v_x,
        v_y=true.v_y + error.v_y,
        psi_dot=true.psi_dot + error.psi_dot,
    )
