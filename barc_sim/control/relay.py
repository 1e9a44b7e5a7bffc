"""Turns a driver's input into commands: what the node `relay` computes, without ROS."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Any

from barc_sim.control.driver import STALE_AFTER, Driver, DriverInput, Limits
from barc_sim.vehicle.parameters import Parameter

if TYPE_CHECKING:
    from collections.abc import Mapping

    from barc_sim.vehicle.bike_model import Input

_LIMITS = Limits()
PARAMETERS = [
    Parameter('acceleration', _LIMITS.acceleration, 'greatest acceleration [m/s²]', (0.0, 100.0)),
    Parameter('deceleration', _LIMITS.deceleration, 'greatest deceleration [m/s²]', (0.0, 100.0)),
    Parameter('speed', _LIMITS.speed, 'greatest speed, either way [m/s]', (0.0, 100.0)),
    Parameter('steering', _LIMITS.steering, 'greatest front angle, either way [rad]', (0.0, 1.5)),
    Parameter(
        'steering_rate',
        _LIMITS.steering_rate,
        'greatest change of the front angle [rad/s]',
        (0.0, 100.0),
    ),
    Parameter(
        'self_centring',
        _LIMITS.self_centring,
        'whether the wheel returns to straight when released; if not, left and right change its '
        'angle, and it stays',
    ),
    Parameter('linear_scale', 1.0, 'share of the limits for a linear of 1', (-100.0, 100.0)),
    Parameter('angular_scale', 1.0, 'share of the limits for an angular of 1', (-100.0, 100.0)),
    Parameter('stale_after', STALE_AFTER, 'age above which a Twist is ignored [s]', (0.05, 60.0)),
]


class RelayControl:
    """A driver with its parameters.

    Attributes
    ----------
    driver
        Makes the commands.
    values
        The parameters by name.
    speed
        [m/s] of the latest state.
    """

    def __init__(self, driver: Driver | None) -> None:
        """Use `driver`, or barc_sim's own."""
        self.driver = driver or Driver()
        self.values: dict[str, Any] = {}
        self.speed = 0.0

    def configure(self, values: Mapping[str, Any]) -> None:
        """Set parameters."""
        self.values.update(values)
        self.driver.limits = Limits(*(self.values[name] for name in Limits._fields))
        self.driver.stale_after = self.values['stale_after']

    def receive(self, request: DriverInput) -> bool:
        """Take a driver's input, in shares before their scale; False if it is not finite."""
        linear, angular = self.values['linear_scale'], self.values['angular_scale']
        scaled = DriverInput(
            request.forward * linear, request.turn * angular, request.brake * linear
        )
        if scaled.usable:
            self.driver.receive(scaled, time.monotonic())
        return scaled.usable

    def command(self) -> Input:
        """Return the command from now on."""
        return self.driver.command(time.monotonic(), self.speed)

    def reset(self) -> None:
        """Begin anew."""
        self.driver.reset()
        self.speed = 0.0
