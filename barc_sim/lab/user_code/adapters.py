"""User code in the places of barc_sim's own."""

from __future__ import annotations

import json
from math import inf, nan
from typing import TYPE_CHECKING

from barc_sim.control.driver import Driver
from barc_sim.control.pid import KD, KI, KP
from barc_sim.vehicle.bike_model import Input

if TYPE_CHECKING:
    from barc_sim.lab.user_code.loading import ControllerFactory, RelayFactory, UserCode

#: The entry of a bag's metadata that tells of user code.
METADATA = 'student_code'
#: What the names of its files are preceded by, as attachments.
FOLDER = 'student/'


class UserController:
    """A user's class `PID` as a `Controller`: limited, and made anew where it is reset.

    The terms are those of the user's object, NaN where it has no `proportional`, `integral` or
    `derivative`; `saturated` is true where it says so itself, too. Changed gains are set where it
    has `kp`, `ki` and `kd`.
    """

    def __init__(self, new: ControllerFactory) -> None:
        """Make a controller with the gains of the run's default."""
        self._new = new
        self.kp, self.ki, self.kd = KP, KI, KD
        self.output_min, self.output_max = -inf, inf
        self.reset()

    def reset(self) -> None:
        """Begin with a fresh object.

        Raises
        ------
        UserCodeError
            where its constructor fails.
        """
        self._gains = self.kp, self.ki, self.kd
        limits = {'output_min': self.output_min, 'output_max': self.output_max}
        self._controller = self._new(*self._gains, **limits)
        self.proportional = self.integral = self.derivative = nan
        self.saturated = False

    def acc_calculate(self, speed_reference: float, speed_current: float, dt: float) -> float:
        """Return the acceleration [m/s²] for speeds in m/s, `dt` seconds after the last call.

        Raises
        ------
        UserCodeError
            where the user's method fails.
        """
        gains = self.kp, self.ki, self.kd
        if gains != self._gains:
            self._gains = gains
            self._controller.set_gains(*gains)
        wanted = self._controller.acc_calculate(speed_reference, speed_current, dt)
        output = min(max(wanted, self.output_min), self.output_max)
        tell = self._controller.tell
        self.proportional, self.integral = tell('proportional'), tell('integral')
        self.derivative = tell('derivative')
        self.saturated = output != wanted or tell('saturated') == 1.0
        return output


class UserDriver(Driver):
    """A user's relay as a `Driver`: it handles all input but the brake.

    Its commands are cut to the car's limits.
    """

    def __init__(self, new: RelayFactory) -> None:
        """Begin with a fresh relay."""
        self._new = new
        super().__init__()

    def reset(self) -> None:
        """Forget all that was heard, and begin with a fresh relay.

        Raises
        ------
        UserCodeError
            where its constructor fails.
        """
        super().reset()
        self._relay = self._new()

    def command(self, t: float, speed: float) -> Input:
        """Return the command from `t` [s] on, at a true speed of `speed` [m/s].

        Raises
        ------
        UserCodeError
            where user code fails.
        """
        own = super().command(t, speed)
        if self.request.brake:
            return own
        motor, servo = self._relay.relay(self.request.forward, self.request.turn, self.dt)
        limits = self.limits
        greatest = max(limits.acceleration, limits.deceleration)
        self.servo = max(-limits.steering, min(servo, limits.steering))
        return Input(max(-greatest, min(motor, greatest)), self.servo)


def describe(user_code: UserCode) -> dict[str, str]:
    """Return what a bag's metadata says of user code: files by part, and hashes."""
    hashes = {source.name: source.sha256 for source in user_code.sources}
    return {METADATA: json.dumps({'files': user_code.files, 'sha256': hashes})} if hashes else {}


def attachments(user_code: UserCode) -> dict[str, bytes]:
    """Return the user's files, by their names as attachments of a bag."""
    return {FOLDER + source.name: source.text.encode() for source in user_code.sources}
