"""User code in place of barc_sim's own controller and driver, and its description in a bag.

Where user code fails, also in a constructor, that is a UserCodeError.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import TYPE_CHECKING

from barc_sim.control.driver import Driver
from barc_sim.control.pid import PID
from barc_sim.control.types import Adapter
from barc_sim.lab.user_code.loading import load_files
from barc_sim.vehicle.bike_model import Command

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from barc_sim.lab.user_code.functions import ControllerFactory, RelayFactory, UserPid
    from barc_sim.lab.user_code.loading import UserCode
    from barc_sim.lab.user_code.relay_program import RelayProgram

#: The entry of a bag's metadata that names the user code.
METADATA = 'student_code'
#: The start of the names of its files, as attachments.
FOLDER = 'student/'


class UserController(Adapter):
    """A user's class `PID` as a `Controller`.

    Its constructor gets the gains, and the limits if it takes them; a reset makes a new object.
    Gains that change later are set if the object has `kp`, `ki` and `kd`.
    """

    kp: float
    ki: float
    kd: float
    _controller: UserPid

    def __init__(self, new: ControllerFactory) -> None:
        """Make a controller with the gains that its file chooses, else those of a run."""
        chosen = getattr(new, 'chosen', None)
        super().__init__(new, values=dict(zip(PID.gains, chosen, strict=False)) if chosen else None)

    def _make(self, values: Mapping[str, float]) -> UserPid:
        limits = {'output_min': self.output_min, 'output_max': self.output_max}
        made: UserPid = self._new(*values.values(), **limits)
        return made

    def _set(self, values: Mapping[str, float]) -> None:
        self._controller.set_gains(*values.values())

    def _read(self, name: str) -> float:
        return self._controller.read(name)


@dataclass(frozen=True)
class UserControllerFile:
    """A user's `controller.py` as a value that other processes can receive.

    Each call loads the file: it may have been edited. The printed text of its code is dropped.
    """

    path: Path

    def __call__(self) -> UserController:
        """Return a new controller."""
        factory = load_files({'controller': self.path}, output=lambda _: None).controller
        assert factory  # noqa: S101 (load_files raises without it)
        return UserController(factory)


class UserDriver(Driver):
    """A user's relay as a `Driver`: it handles all input but the brake.

    Its commands are cut to the car's limits.
    """

    def __init__(self, new: RelayFactory | RelayProgram) -> None:
        """Start with a new relay."""
        self._new = new
        super().__init__()

    def reset(self) -> None:
        """Clear the request, and start with a new relay."""
        super().reset()
        self._relay = self._new()

    def command(self, t: float, speed: float) -> Command:
        """Return the command from `t` [s] on, at a true speed of `speed` [m/s]."""
        own = super().command(t, speed)
        if self.request.brake:
            return own
        motor, servo = self._relay.relay(self.request.forward, self.request.turn, self.dt)
        limits = self.limits
        greatest = max(limits.acceleration, limits.deceleration)
        self.servo = max(-limits.steering, min(servo, limits.steering))
        return Command(max(-greatest, min(motor, greatest)), self.servo)


def describe(user_code: UserCode) -> dict[str, str]:
    """Return the metadata of user code in a bag: files by part, and hashes."""
    hashes = {source.name: source.sha256 for source in user_code.sources}
    return {METADATA: json.dumps({'files': user_code.files, 'sha256': hashes})} if hashes else {}


def attachments(user_code: UserCode) -> dict[str, bytes]:
    """Return the user's files, by their names as attachments of a bag."""
    return {FOLDER + source.name: source.text.encode() for source in user_code.sources}


def attached(found: Mapping[str, bytes]) -> dict[str, bytes]:
    """Return the user's files among the attachments of a bag, by their own names."""
    names = {name: name.removeprefix(FOLDER) for name in found if name.startswith(FOLDER)}
    return {own: found[name] for name, own in names.items()}
