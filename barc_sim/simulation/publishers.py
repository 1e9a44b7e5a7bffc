"""What a simulator and a controller publish, on the topics that ROS or a call carries."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Protocol

from barc_sim.simulation.log import (
    CLOCK,
    COMMAND,
    CONTROLLER_STATE,
    ENVIRONMENT,
    MESSAGE_TYPES,
    PID_STATE,
    STATE,
    STATE_ERROR,
)
from barc_sim.vehicle.bike_model import Command

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from barc_sim.control.cruise_control import Answer, CruiseControl
    from barc_sim.vehicle.plant import Observation


class Publisher(Protocol):
    """Publishes the messages of one topic."""

    wanted: bool  #: whether anybody receives them; otherwise they need not be made

    def publish(self, stamp: int, fields: Mapping[str, Any]) -> None:
        """Publish the message stamped `stamp` [ns] with `fields`, by name."""


if TYPE_CHECKING:
    #: Makes a publisher on a topic, given its name and type.
    MakePublisher = Callable[[str, str], Publisher]


class StatePublishers:
    """Publishes each state on its topics: `/clock` first, and last `z_vhcl`, which is answered.

    Examples
    --------
    >>> from types import SimpleNamespace
    >>> from barc_sim.vehicle.plant import Plant
    >>> def publisher(topic, kind):
    ...     return SimpleNamespace(wanted=True, publish=lambda stamp, fields: print(topic, stamp))
    >>> StatePublishers(publisher, clock=True).publish(Plant().observe(), stamp=20_000_000)
    /clock 20000000
    environment 20000000
    ez_vhcl 20000000
    z_vhcl 20000000
    """

    def __init__(self, make: MakePublisher, *, clock: bool) -> None:
        """Create the publishers, with that of `/clock` if `clock` is true."""
        self._state_error, self._environment, self._state = (
            make(topic, MESSAGE_TYPES[topic]) for topic in (STATE_ERROR, ENVIRONMENT, STATE)
        )
        self._make = make
        self._clock: Publisher | None = None
        if clock:
            self.begin_clock()

    @property
    def keeps_clock(self) -> bool:
        """Whether `/clock` is published."""
        return self._clock is not None

    def begin_clock(self) -> None:
        """Publish `/clock` with each state from now on."""
        self._clock = self._clock or self._make(CLOCK, 'rosgraph_msgs/msg/Clock')

    def publish(self, seen: Observation, stamp: int) -> None:
        """Publish what was observed at the time `stamp` [ns]."""
        self._seen, self._stamp = seen, stamp
        self.publish_clock()
        if self._environment.wanted:
            road = {'theta': seen.theta_deg, 'elevation': seen.elevation}
            self._environment.publish(stamp, road | seen.forces._asdict())
        self.republish()

    def republish(self) -> None:
        """Publish the latest state again, for a controller that has started since.

        Call it after `publish` only.
        """
        if self._state_error.wanted:
            self._state_error.publish(self._stamp, self._seen.error._asdict())
        if self._state.wanted:
            self._state.publish(self._stamp, self._seen.measured._asdict())

    def publish_clock(self) -> None:
        """Publish the time of the latest state on `/clock`."""
        if self._clock and self._clock.wanted:
            self._clock.publish(self._stamp, {})


class AnswerPublishers:
    """Publishes a controller's commands, and what it has computed for each."""

    def __init__(self, make: MakePublisher, control: CruiseControl) -> None:
        """Create the publishers: what a PID computes has a topic of its own."""
        self._control = control
        topic = PID_STATE if control.is_pid else CONTROLLER_STATE
        self._command, self._state = (make(name, MESSAGE_TYPES[name]) for name in (COMMAND, topic))

    def publish(self, stamp: int, answer: Answer) -> Command:
        """Publish and return the command that answers the state stamped `stamp` [ns]."""
        command = Command(motor=answer.acceleration)
        if self._command.wanted:
            self._command.publish(stamp, command._asdict())
        if self._state.wanted:
            self._state.publish(stamp, self._control.computed(answer))
        return command
