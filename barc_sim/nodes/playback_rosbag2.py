"""The services of `ros2 bag play`, by its names and types, for its clients."""

from __future__ import annotations

from importlib import import_module
from math import inf
from typing import TYPE_CHECKING, Any

from barc_sim.interfaces.services import ROSBAG2_PLAYER
from barc_sim.interfaces.stamps import to_nanoseconds

if TYPE_CHECKING:
    from rclpy.node import Node

    from barc_sim.nodes.playback_clock import PlaybackClock
    from barc_sim.nodes.playback_controls import PlaybackControls


class Rosbag2PlayerServices:
    """Controls a playback by the services of `ros2 bag play`.

    `play` is not among them: a player plays from its start to its end, as that of the command does.

    Parameters
    ----------
    node
        The node that serves them.
    clock, controls
        What they control.

    Raises
    ------
    ModuleNotFoundError
        Their types, the package `rosbag2_interfaces`, are not installed.
    """

    def __init__(self, node: Node, clock: PlaybackClock, controls: PlaybackControls) -> None:
        types = import_module('rosbag2_interfaces.srv')
        self._clock = clock
        self._controls = controls
        callbacks = {
            'pause': (types.Pause, self._on_pause),
            'resume': (types.Resume, self._on_resume),
            'toggle_paused': (types.TogglePaused, self._on_toggle_paused),
            'is_paused': (types.IsPaused, self._on_is_paused),
            'get_rate': (types.GetRate, self._on_get_rate),
            'set_rate': (types.SetRate, self._on_set_rate),
            'play_next': (types.PlayNext, self._on_play_next),
            'burst': (types.Burst, self._on_burst),
            'seek': (types.Seek, self._on_seek),
            'stop': (types.Stop, self._on_stop),
        }
        for name, (service_type, callback) in callbacks.items():
            node.create_service(service_type, f'{ROSBAG2_PLAYER}/{name}', callback)

    def _on_pause(self, _: object, response: Any) -> Any:  # noqa: ANN401 (not installed everywhere)
        self._clock.pause()
        return response

    def _on_resume(self, _: object, response: Any) -> Any:  # noqa: ANN401
        self._clock.resume()
        return response

    def _on_toggle_paused(self, _: object, response: Any) -> Any:  # noqa: ANN401
        self._clock.toggle_pause()
        return response

    def _on_is_paused(self, _: object, response: Any) -> Any:  # noqa: ANN401
        response.paused = self._clock.is_paused
        return response

    def _on_get_rate(self, _: object, response: Any) -> Any:  # noqa: ANN401
        response.rate = self._clock.rate
        return response

    def _on_set_rate(self, request: Any, response: Any) -> Any:  # noqa: ANN401
        response.success = self._controls.set_rate(request.rate)
        return response

    def _on_play_next(self, _: object, response: Any) -> Any:  # noqa: ANN401
        response.success = self._clock.step() > 0
        return response

    def _on_burst(self, request: Any, response: Any) -> Any:  # noqa: ANN401
        response.actually_burst = self._clock.step(request.num_messages or inf)
        return response

    def _on_seek(self, request: Any, response: Any) -> Any:  # noqa: ANN401
        response.success = self._controls.seek(to_nanoseconds(request.time))
        return response

    def _on_stop(self, _: object, response: Any) -> Any:  # noqa: ANN401
        self._clock.stop()
        return response
