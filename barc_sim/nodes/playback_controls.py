"""What controls a playback: parameters, services, and the keys of a terminal.

A rate is a state with limits, so it is a parameter: `ros2 param` reads, checks and sets it. No
standard service type has a time, so that `seek_to` is a parameter, too.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from rclpy.parameter import Parameter
from std_srvs.srv import Trigger

from barc_sim.bags.playback_settings import RATE, SEEK_TO
from barc_sim.interfaces import services
from barc_sim.ros.parameters import declare, descriptor

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from rclpy.node import Node

    from barc_sim.nodes.playback_clock import PlaybackClock

_RATE_STEP = 0.1  #: by which a key changes the rate


class PlaybackControls:
    """Controls the clock of a playback by parameters, services and keys.

    Parameters
    ----------
    node
        The node with the parameters `rate` and `seek_to`, and the services of the type Trigger.
    clock
        The clock.
    start
        The time of the first message [ns].
    first, last
        The times between which a playback can continue [ns].
    """

    def __init__(
        self, node: Node, clock: PlaybackClock, *, start: int, first: int, last: int
    ) -> None:
        self._node = node
        self._clock = clock
        self._start = start
        self._first = first
        self._last = last

        rate = declare(node, [RATE._replace(default=clock.rate)])[RATE.name]
        clock.set_rate(rate)
        limits = ((first - start) / 1e9, (last - start) / 1e9)
        seek_to = SEEK_TO._replace(default=limits[0], between=limits)
        node.declare_parameter(
            seek_to.name, seek_to.default, descriptor(seek_to), ignore_override=True
        )
        node.add_post_set_parameters_callback(self._on_parameters)

        self._serve(services.PAUSE_PLAYER, clock.pause)
        self._serve(services.RESUME_PLAYER, clock.resume)
        self._serve(services.TOGGLE_PLAYER, clock.toggle_pause)
        self._serve(services.STEP_PLAYER, self._play_next)
        self._serve(services.STOP_PLAYER, clock.stop)

    def on_key(self, key: str) -> None:
        """Handle a key: `space` pauses or resumes, `right` steps, `up` and `down` set the rate."""
        if key == 'space':
            self._clock.toggle_pause()
        elif key == 'right':
            self._clock.add_step()
        elif key == 'up':
            self.set_rate(self._clock.rate + _RATE_STEP)
        elif key == 'down':
            self.set_rate(self._clock.rate - _RATE_STEP)
        elif key == 'quit':
            self._clock.stop()

    def set_rate(self, rate: float) -> bool:
        """Set the parameter `rate`; return whether it is within its limits.

        At the end of the playback nothing is set: the node may be destroyed.
        """
        if self._clock.is_stopped:
            return False
        (result,) = self._node.set_parameters([Parameter(RATE.name, value=rate)])
        return bool(result.successful)

    def seek(self, to: int) -> bool:
        """Continue at the bag's time `to` [ns]; return whether it is not after the last message.

        A time before the first message to play counts as the time of that.
        """
        return to <= self._last and self._clock.seek(max(to, self._first))

    def _on_parameters(self, parameters: Sequence[Parameter[float]]) -> None:
        for parameter in parameters:
            if parameter.name == RATE.name:
                self._clock.set_rate(parameter.value)
            elif parameter.name == SEEK_TO.name:
                to = self._start + round(parameter.value * 1e9)
                self.seek(min(to, self._last))

    def _play_next(self) -> str | None:
        """Publish one message; return why not."""
        if not self._clock.is_paused:
            return 'the playback is not paused: pause it first'
        return None if self._clock.step() else 'the playback is at its end'

    def _serve(self, name: str, control: Callable[[], str | None]) -> None:
        """Serve a control, which returns why it failed."""

        def answer(_: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
            failure = control()
            response.success = not failure
            response.message = failure or self._state
            return response

        self._node.create_service(Trigger, name, answer)

    @property
    def _state(self) -> str:
        """What the playback does, and where."""
        if self._clock.is_stopped:
            state = 'stopped'
        else:
            state = 'paused' if self._clock.is_paused else 'playing'
        return f'{state} at {(self._clock.now - self._start) / 1e9:.3f} s'
