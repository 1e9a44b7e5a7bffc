"""User code in the places of barc_sim's own."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

from barc_sim.control.adapter import Adapter
from barc_sim.control.driver import Driver
from barc_sim.vehicle.bike_model import Input

if TYPE_CHECKING:
    from collections.abc import Mapping

    from barc_sim.lab.user_code.functions import UserPid
    from barc_sim.lab.user_code.loading import ControllerFactory, RelayFactory, UserCode

#: The entry of a bag's metadata that names the user code.
METADATA = 'student_code'
#: What the names of its files are preceded by, as attachments.
FOLDER = 'student/'


class UserController(Adapter):
    """A user's class `PID` as a `Controller`.

    It gets the gains, and where it takes them the limits, at its construction and after each reset.
    Gains that change later are set where it has `kp`, `ki` and `kd`.
    """

    kp: float
    ki: float
    kd: float
    _controller: UserPid

    def __init__(self, new: ControllerFactory) -> None:
        """Make a controller with the gains of the run's default.

        Raises
        ------
        UserCodeError
            where its constructor fails.
        """
        super().__init__(new)

    def _make(self, values: Mapping[str, float]) -> UserPid:
        limits = {'output_min': self.output_min, 'output_max': self.output_max}
        made: UserPid = self._new(*values.values(), **limits)
        return made

    def _set(self, values: Mapping[str, float]) -> None:
        self._controller.set_gains(*values.values())

    def _read(self, name: str) -> float:
        return self._controller.tell(name)


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
    """Return the metadata of user code in a bag: files by part, and hashes."""
    hashes = {source.name: source.sha256 for source in user_code.sources}
    return {METADATA: json.dumps({'files': user_code.files, 'sha256': hashes})} if hashes else {}


def attachments(user_code: UserCode) -> dict[str, bytes]:
    """Return the user's files, by their names as attachments of a bag."""
    return {FOLDER + source.name: source.text.encode() for source in user_code.sources}
