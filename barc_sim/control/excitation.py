"""Test signals that excite a car, so that `identify` can estimate its parameters.

Each is a controller, and drives a run as any other does: ``--controller-type prbs``. After Ljung,
"System Identification", 2nd ed., section 13.3.
"""

from __future__ import annotations

from math import inf, pi, sin
from typing import TYPE_CHECKING

from barc_sim.control.lane import LaneLQR
from barc_sim.control.speed import Gain, take_gains

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from barc_sim.control.lane import Curvature


class Steps:
    """Steps up, back, down and back, added to a slow P controller that keeps the speed.

    They show delay and lag by eye. The other signals of the motor differ in `values` or `signal`.
    """

    gains: Mapping[str, Gain] = {
        'amplitude': Gain(2.0, 'm/s²', 'amplitude of the test signal', 8.0, (0.0, 1e3)),
        'hold': Gain(0.5, '1/s', 'gain that keeps the speed near its reference', 5.0, (0.0, 1e3)),
        'interval': Gain(2.0, 's', 'time between two steps', 20.0, (1e-3, 1e3)),
    }
    terms: Mapping[str, str] = {
        'test_signal': 'the signal that excites the car',
        'holding': 'the P controller near the reference',
    }
    amplitude: float
    hold: float
    interval: float
    values: Sequence[int] = (0, 1, 0, -1)  #: times the amplitude, in turn

    def __init__(
        self, *, output_min: float = -inf, output_max: float = inf, **gains: float
    ) -> None:
        """Take the gains by name, and limits of the output [m/s²]."""
        take_gains(self, gains)
        self.output_min = output_min
        self.output_max = output_max
        self.reset()

    def reset(self) -> None:
        """Restart the signal."""
        self.t = -inf  #: [s] since the first call
        self.test_signal = 0.0
        self.holding = 0.0
        self.saturated = False

    def acc_calculate(
        self, speed_reference: float, speed_current: float, dt: float = 0.02
    ) -> float:
        """Return the acceleration [m/s²] for speeds in m/s, `dt` seconds after the last call."""
        self.t = max(self.t + dt, 0.0)
        self.holding = self.hold * (speed_reference - speed_current)
        self.test_signal = self.signal(speed_reference, speed_current)

        raw = self.holding + self.test_signal
        self.saturated = not self.output_min <= raw <= self.output_max
        return min(max(raw, self.output_min), self.output_max)

    def signal(self, _: float, __: float, /) -> float:
        """Return the signal [m/s²] at `t`, for the speeds of `acc_calculate`."""
        return self.amplitude * self.values[int(self.t / self.interval + 1e-9) % len(self.values)]


def _binary_sequence() -> list[int]:
    """Return the 1,023 bits of a shift register with the primitive polynomial x¹⁰ + x⁷ + 1."""
    bits = [1, 0, 1, 0, 1, 0, 0, 1, 0, 1]
    while len(bits) < 1023:  # noqa: PLR2004
        bits.append(bits[-10] ^ bits[-7])
    return bits[9:] + bits[:9]


class PRBS(Steps):
    """A pseudorandom binary sequence, of period 1,023: it shows delay and lag of the motor.

    Examples
    --------
    >>> from barc_sim import identify, simulate
    >>> log = simulate(controller=PRBS(), delay=0.1, noise=0.02, road='flat', distance=40.0)
    >>> print(identify(log)['motor_delay'])
    0.10019 ± 0.00089 s
    """

    gains: Mapping[str, Gain] = {
        **Steps.gains,
        'interval': Gain(0.3, 's', 'minimum time between two changes', 2.0, (1e-3, 100.0)),
    }
    values = tuple(1 if bit else -1 for bit in _binary_sequence())


class CoastDown(Steps):
    """Accelerates to the reference, then rolls until a share of it: shows drag and friction."""

    gains: Mapping[str, Gain] = {
        'amplitude': Steps.gains['amplitude'],
        'hold': Steps.gains['hold']._replace(default=0.0),
        'share': Gain(
            0.3, '-', 'share of the reference at which it accelerates again', 1.0, (0.0, 1.0)
        ),
    }
    share: float

    def signal(self, speed_reference: float, speed_current: float, /) -> float:
        """Return the amplitude while the car accelerates, and 0 while it rolls."""
        rolls = self.t > 0.0 and self.test_signal == 0.0
        rolls = speed_current > speed_reference * (self.share if rolls else 1.0)
        return 0.0 if rolls else self.amplitude


class SineSteer(LaneLQR):
    """Keeps the lane, with a sine added to the steering: shows tyres and yaw inertia."""

    gains: Mapping[str, Gain] = {
        **LaneLQR.gains,
        'amplitude': Gain(0.05, 'rad', 'amplitude of the sine', 0.5, (0.0, 1.0)),
        'frequency': Gain(0.5, 'Hz', 'frequency of the sine', 5.0, (0.0, 100.0)),
    }
    amplitude: float
    frequency: float
    dt = 0.02  #: [s] between two calls

    def reset(self) -> None:
        """Restart the sine."""
        super().reset()
        self._calls = 0

    def steer_calculate(
        self, e_y: float, e_psi: float, speed: float, curvature: Curvature
    ) -> float:
        """Return the front angle [rad] for errors in metres and radians, and a speed in m/s."""
        sine = self.amplitude * sin(2.0 * pi * self.frequency * self._calls * self.dt)
        self._calls += 1
        return super().steer_calculate(e_y, e_psi, speed, curvature) + sine
