"""The services and the event of `ros2 bag record`, by its names and types, for its clients."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from rclpy.clock import Clock, ClockType

from barc_sim.errors import UserError
from barc_sim.interfaces.services import ROSBAG2_RECORDER
from barc_sim.interfaces.topics import WRITE_SPLIT

if TYPE_CHECKING:
    from barc_sim.nodes.recorder import BagRecorder

_EVENT_PERIOD = 0.1  #: [s] between two searches for new files


class Rosbag2RecorderServices:
    """Controls a recording by the services of `ros2 bag record`.

    A message on `events/write_split` names each file that has ended.

    Parameters
    ----------
    recorder
        What they control; it serves them.

    Raises
    ------
    ModuleNotFoundError
        Their package, `rosbag2_interfaces`, is not installed.
    """

    def __init__(self, recorder: BagRecorder) -> None:
        types = import_module('rosbag2_interfaces.srv')
        messages = import_module('rosbag2_interfaces.msg')
        self._recorder = recorder

        self._event = messages.WriteSplitEvent(node_name=recorder.get_fully_qualified_name())
        self._event_publisher = recorder.create_publisher(messages.WriteSplitEvent, WRITE_SPLIT, 1)
        self._file_count = len(recorder.files)

        callbacks = {
            'pause': (types.Pause, self._on_pause),
            'resume': (types.Resume, self._on_resume),
            'is_paused': (types.IsPaused, self._on_is_paused),
            'split_bagfile': (types.SplitBagfile, self._on_split),
            'stop': (types.Stop, self._on_stop),
        }
        if recorder.takes_snapshots:
            callbacks['snapshot'] = (types.Snapshot, self._on_snapshot)
        for name, (service_type, callback) in callbacks.items():
            recorder.create_service(service_type, f'{ROSBAG2_RECORDER}/{name}', callback)

        steady = Clock(clock_type=ClockType.STEADY_TIME)
        recorder.create_timer(_EVENT_PERIOD, self._publish_events, clock=steady)

    def _on_pause(self, _: object, response: Any) -> Any:  # noqa: ANN401 (not installed everywhere)
        self._recorder.pause()
        return response

    def _on_resume(self, _: object, response: Any) -> Any:  # noqa: ANN401
        self._recorder.resume()
        return response

    def _on_is_paused(self, _: object, response: Any) -> Any:  # noqa: ANN401
        response.paused = self._recorder.is_paused
        return response

    def _on_split(self, _: object, response: Any) -> Any:  # noqa: ANN401
        try:
            self._recorder.split()
        except UserError as error:  # the response has no room for it
            self._recorder.get_logger().error(str(error))
        return response

    def _on_snapshot(self, _: object, response: Any) -> Any:  # noqa: ANN401
        response.success = self._recorder.snapshot()
        return response

    def _on_stop(self, _: object, response: Any) -> Any:  # noqa: ANN401
        self._recorder.stop()
        return response

    def _publish_events(self) -> None:
        """Publish the event of each file that has ended since the last call."""
        files = [file.absolute() for file in self._recorder.files]
        # A file is made once the one before it is whole.
        while self._file_count < len(files) and files[self._file_count].exists():
            self._event.closed_file = str(files[self._file_count - 1])
            self._event.opened_file = str(files[self._file_count])
            self._event_publisher.publish(self._event)
            self._file_count += 1
