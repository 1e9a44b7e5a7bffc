"""What the simulators with and without ROS share: the stepper, parameters and warnings."""

from __future__ import annotations

from functools import partial
from math import inf
from typing import TYPE_CHECKING, Any

from barc_sim.errors import UserError
from barc_sim.simulation.stepper import Stepper
from barc_sim.simulation.stepper_interface import Outputs, Settings
from barc_sim.vehicle.bike_model import Command
from barc_sim.vehicle.parameters import LIVE, PARAMETERS, REALTIME_FACTORS, Parameter, plant, retune
from barc_sim.vehicle.road import Road

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from barc_sim.simulation.publishers import StatePublishers
    from barc_sim.vehicle.bike_model import Model
    from barc_sim.vehicle.plant import Observation

#: [s] between two checks of a simulator's peers.
CHECK_PERIOD = 1.0


class Simulator(Outputs):
    """A simulator with or without ROS: what it passes on to and from its `Stepper`.

    Attributes
    ----------
    road
        The road, read once.
    values
        The parameters, by name. Noise and actuators may be changed while the car drives.
    """

    _state_publishers: StatePublishers
    _deadlines: Any = None  # a timer with `reset` and `cancel`; None in lock-step

    def _set_up(
        self,
        values: dict[str, Any],
        road: Road | None,
        model: Model,
        on_step: Callable[[float, Observation], None] | None,
    ) -> None:
        """Make the stepper; `road` replaces the one that the parameter `road` names."""
        self.values = values
        self.road = road or Road.named(values['road'])
        self._on_step = on_step
        self._stepper = Stepper(partial(plant, values, model, self.road), self, _settings(values))

    @property
    def paused(self) -> bool:
        """Whether simulated time stands still on request."""
        return self._stepper.paused

    @property
    def states(self) -> int:
        """States published."""
        return self._stepper.states

    @property
    def missed(self) -> int:
        """Commands that had not arrived when they were due."""
        return self._stepper.missed

    @property
    def slipped(self) -> int:
        """Periods by which simulated time has fallen behind the wall clock."""
        return self._stepper.slipped

    @property
    def stamp_lag(self) -> float:
        """Time [s] by which stamps in real time are behind the wall clock; 0 at other paces."""
        return self._stepper.stamp_lag

    @property
    def keeps_clock(self) -> bool:
        """Whether it publishes `/clock`."""
        return self._state_publishers.keeps_clock

    def end(self) -> None:
        """End the run once the present state is answered; call it in `on_step` only."""
        self._stepper.end()

    def publish_state(self, t: float, seen: Observation, stamp_ns: int) -> None:
        """Publish what was observed at `t` [s], stamped `stamp_ns` [ns]."""
        self._state_publishers.publish(seen, stamp_ns)
        if self._on_step:
            self._on_step(t, seen)

    def start_deadlines(self) -> None:
        """Start the timer of the deadlines."""
        if self._deadlines:
            self._deadlines.reset()

    def stop_deadlines(self) -> None:
        """Stop the timer of the deadlines."""
        if self._deadlines:
            self._deadlines.cancel()

    def _change(self, values: Mapping[str, Any]) -> None:
        """Set parameters while the car drives."""
        self.values.update(values)
        self._stepper.change(partial(retune, self.values))


def parameters(distance: float = 0.0) -> list[Parameter]:
    """Return the parameters' declarations; `distance` [m] is the default of the parameter."""
    table = [parameter._replace(read_only=parameter.name not in LIVE) for parameter in PARAMETERS]
    end = 'a lap ends here [m]; 0: it does not end'
    count = 'the run ends after so many; 0: it goes on'
    return [
        *table,
        Parameter('distance', distance, end, (0.0, 1e6), read_only=True),
        Parameter('laps', 1, count, (0, 10**6), read_only=True),
    ]


def _settings(values: Mapping[str, Any]) -> Settings:
    """Return the stepper's settings of the parameters' values.

    Raises
    ------
    UserError
        There are several laps, and no distance at which one ends; or time would hardly pass.
    """
    low, high = REALTIME_FACTORS
    if 0.0 < values['realtime_factor'] < low:
        raise UserError(
            f'realtime_factor {values["realtime_factor"]:g} is so small that time hardly passes: '
            f'expected 0, or {low:g} to {high:g}'
        )
    if values['laps'] != 1 and not values['distance']:
        raise UserError(
            f'laps {values["laps"]} with distance 0, at which no lap ends: expected a distance '
            'above 0, or one lap'
        )
    return Settings(
        realtime_factor=values['realtime_factor'],
        distance=values['distance'] or inf,
        laps=values['laps'],
        command_timeout=values['command_timeout'],
        timeout_braking=values['timeout_braking'],
        max_command=Command(values['refuse_motor_above'], values['refuse_servo_above']),
    )


def publishes_clock(values: Mapping[str, Any]) -> bool:
    """Return whether simulated time is published: on demand, and where it is not real time.

    Examples
    --------
    >>> publishes_clock({'clock': False, 'realtime_factor': 2.0})
    True
    """
    return bool(values['clock']) or values['realtime_factor'] != 1.0


def missed_deadline(state: int, missed: int) -> str:
    """Return the warning that no command answers `state` in time; `missed` counts such states.

    Examples
    --------
    >>> missed_deadline(state=120, missed=1)
    'missed deadline 1: no command answers state 120 in time; the last one holds'
    """
    return f'missed deadline {missed}: no command answers state {state} in time; the last one holds'


def stamps_behind(behind: float, *, clock: bool) -> str:
    """Return the warning that stamps are `behind` [s]; `clock`: whether `/clock` is published."""
    where = '; /clock has the simulated time from now on' if clock else ''
    return (
        f'stamps are {behind:.1f} s behind the wall clock, as time stood still{where}: set '
        'use_sim_time in nodes that compare stamps with their clock, or reset the run'
    )


def commands_lost(timeout: float) -> str:
    """Return the warning that no command has arrived for `timeout` [s].

    Examples
    --------
    >>> commands_lost(0.5)
    'no command for 0.5 s: the car brakes to a standstill'
    """
    return f'no command for {timeout:g} s: the car brakes to a standstill'
