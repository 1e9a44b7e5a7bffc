"""Turns a driver's input into commands: what the node `relay` computes, without ROS."""

from __future__ import annotations

import time
from math import isfinite
from typing import TYPE_CHECKING, Any

from barc_sim.control.driver import STALE_AFTER, Driver, DriverInput, Limits, VelocityDriver
from barc_sim.errors import UserError
from barc_sim.vehicle.parameters import PARAMETERS as CAR
from barc_sim.vehicle.parameters import Parameter

if TYPE_CHECKING:
    from collections.abc import Mapping

    from barc_sim.vehicle.bike_model import Command

#: What a Twist means, by the value of the parameter `input`.
INPUTS: dict[str, type[Driver]] = {'pedal': Driver, 'velocity': VelocityDriver}
PEDAL = 'pedal'
_LIMITS = Limits()
PARAMETERS = [
    Parameter(
        'input',
        PEDAL,
        "what a Twist means: 'pedal', shares of the limits below, from -1 to 1; or 'velocity', the "
        'speed linear.x [m/s] and the yaw rate angular.z [rad/s], as in REP-103',
        read_only=True,
    ),
    Parameter('acceleration', _LIMITS.acceleration, 'maximum acceleration [m/s²]', (0.0, 100.0)),
    Parameter('deceleration', _LIMITS.deceleration, 'maximum deceleration [m/s²]', (0.0, 100.0)),
    Parameter('speed', _LIMITS.speed, 'maximum speed, either way [m/s]', (0.0, 100.0)),
    Parameter('steering', _LIMITS.steering, 'maximum front angle, either way [rad]', (0.0, 1.5)),
    Parameter(
        'steering_rate',
        _LIMITS.steering_rate,
        'maximum change of the front angle [rad/s]',
        (0.0, 100.0),
    ),
    Parameter(
        'self_centring',
        _LIMITS.self_centring,
        'whether the wheel returns to straight when released; if not, left and right change its '
        'angle, and it stays',
    ),
    Parameter('linear_scale', 1.0, 'factor of a linear, before its limit', (-100.0, 100.0)),
    Parameter('angular_scale', 1.0, 'factor of an angular, before its limit', (-100.0, 100.0)),
    Parameter('stale_after', STALE_AFTER, 'age above which a Twist is ignored [s]', (0.05, 60.0)),
    # The car's geometry, from which the velocity's steering follows.
    *(each for each in CAR if each.name in ('l_f', 'l_r')),
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

    def __init__(self, driver: Driver | None, values: Mapping[str, Any]) -> None:
        """Use `driver`, or barc_sim's own for the parameter `input`.

        Raises
        ------
        UserError
            if `input` has another value than those of `INPUTS`, or none that `driver` has.
        """
        meaning = values['input']
        if meaning not in INPUTS:
            raise UserError(
                f'parameter input of relay is {meaning!r}: expected one of {", ".join(INPUTS)}'
            )
        if driver and meaning != PEDAL:
            raise UserError(
                f'parameter input of relay is {meaning!r}, which is for the relay of barc_sim: a '
                "relay of one's own gets each Twist as shares of the limits"
            )
        self.driver = driver or INPUTS[meaning]()
        self.values: dict[str, Any] = {}
        self.speed = 0.0
        self.configure(values)

    def configure(self, values: Mapping[str, Any]) -> None:
        """Set parameters."""
        self.values.update(values)
        self.driver.limits = Limits(*(self.values[name] for name in Limits._fields))
        self.driver.stale_after = self.values['stale_after']
        if isinstance(self.driver, VelocityDriver):
            self.driver.wheelbase = self.values['l_f'] + self.values['l_r']

    def receive(self, request: DriverInput) -> bool:
        """Take a driver's input before its scale; False if it is not finite."""
        linear, angular = self.values['linear_scale'], self.values['angular_scale']
        scaled = DriverInput(
            request.forward * linear, request.turn * angular, request.brake * linear
        )
        if scaled.usable:
            self.driver.receive(scaled, time.monotonic())
        return scaled.usable

    def take_speed(self, speed: float) -> None:
        """Take the car's speed [m/s] unless it is not finite."""
        if isfinite(speed):
            self.speed = speed

    def command(self) -> Command:
        """Return the command from now on."""
        return self.driver.command(time.monotonic(), self.speed)

    def reset(self) -> None:
        """Begin anew."""
        self.driver.reset()
        self.speed = 0.0
