"""What drives by hand without ROS: the relay, and the keyboard of the terminal."""

from __future__ import annotations

import time
from functools import partial
from typing import TYPE_CHECKING, Any

from barc_sim.bags.messages import CMD_VEL, message_class
from barc_sim.control.driver import FULL_BRAKE, RATE, DriverInput
from barc_sim.control.keyboard import PRESS_HOLD, REPEAT_HOLD, HeldKeys
from barc_sim.control.relay import PARAMETERS, RelayControl
from barc_sim.simulation.log import COMMAND, MESSAGE_TYPES

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from barc_sim.control.driver import Driver
    from barc_sim.control.keyboard import KeyEvent, Terminal
    from barc_sim.runs.local.host import LocalHost
    from barc_sim.runs.local.topics import Publisher
    from barc_sim.vehicle.bike_model import Command
    from barc_sim.vehicle.plant import Observation


class LocalRelay:
    """Publishes commands all the time: when nobody drives, the car coasts, or stops by `velocity`.

    Attributes
    ----------
    on_command
        Called with each command.

    Examples
    --------
    >>> from barc_sim.runs.local.host import LocalHost
    >>> host, commands = LocalHost([]), []
    >>> relay = LocalRelay(host, None, {})
    >>> relay.on_command = lambda command, _: commands.append(command)
    >>> relay.receive(DriverInput(forward=0.5))
    True
    >>> host.loop.run(lambda: commands)
    >>> commands
    [Command(motor=2.0, servo=0.0)]
    """

    def __init__(self, host: LocalHost, driver: Driver | None, given: Mapping[str, Any]) -> None:
        """Declare the parameters, some `given`; `driver` replaces barc_sim's own.

        Raises
        ------
        UserError
            if a parameter is out of range.
        """
        node = host.node('relay')
        self._control = RelayControl(driver, node.declare(PARAMETERS, given))
        self.receive = self._control.receive
        self.reset = self._control.reset
        self._command = node.publisher(COMMAND, MESSAGE_TYPES[COMMAND])
        self.on_command: Callable[[Command, int], object] = lambda *_: None
        host.loop.timer(self.driver.dt, self._publish).reset()

    @property
    def driver(self) -> Driver:
        """Makes the commands."""
        return self._control.driver

    def take_state(self, _: int, seen: Observation) -> None:
        """Take the car's speed."""
        self._control.speed = seen.measured.v_x

    def _publish(self) -> None:
        command = self._control.command()
        if self._command.wanted:
            self._command.publish(0, command._asdict())
        self.on_command(command, 0)


class DriverTopic:
    """The topic `cmd_vel` of a node that drives."""

    def __init__(self, host: LocalHost, node: str, relay: LocalRelay | None) -> None:
        """Publish for the node named `node`, and pass its input to `relay`, if there is one."""
        self._publisher: Publisher = host.topics.publisher(node, CMD_VEL, 'geometry_msgs/msg/Twist')
        self._relay = relay

    def publish(self, request: DriverInput) -> None:
        """Publish a driver's input as a Twist."""
        if self._publisher.wanted:
            vector = message_class('geometry_msgs/msg/Vector3')
            linear = vector(x=request.forward, y=0.0, z=-request.brake or 0.0)
            angular = vector(x=0.0, y=0.0, z=request.turn)
            self._publisher.publish(0, {'linear': linear, 'angular': angular})
        if self._relay:
            self._relay.receive(request)


class LocalKeyboard:
    """Publishes while a key is held, zero once after its release, and then nothing."""

    def __init__(
        self,
        host: LocalHost,
        terminal: Terminal,
        relay: LocalRelay,
        on_reset: Callable[[], None],
        on_quit: Callable[[], None],
    ) -> None:
        """Read keys from `terminal`."""
        node = host.node('keyboard')
        self._topic = DriverTopic(host, node.name, relay)
        self._host, self._terminal = host, terminal
        self._keys = HeldKeys(PRESS_HOLD, REPEAT_HOLD)
        self._on_reset, self._on_quit = on_reset, on_quit
        self._timer = host.loop.timer(1.0 / RATE, self._publish)
        self._timer.reset()
        terminal.listen(self._on_event)

    def close(self) -> None:
        """Restore the terminal, and brake."""
        self._terminal.close()
        self._topic.publish(FULL_BRAKE)

    def _on_event(self, event: KeyEvent) -> None:
        """Pass an event from the terminal's thread to the loop's."""
        if event.key == 'quit':
            self._on_quit()
        else:
            self._host.loop.call(partial(self._handle, event, time.monotonic()))

    def _handle(self, event: KeyEvent, t: float) -> None:
        if self._keys.handle(event, t) and event.key == 'reset':
            self._on_reset()
        self._publish()
        self._timer.reset()

    def _publish(self) -> None:
        request = self._keys.request(time.monotonic())
        if request is not None:
            self._topic.publish(request)
