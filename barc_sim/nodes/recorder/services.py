"""The recorder's services, under rosbag2's names.

Their types are std_srvs' Trigger: rosbag2_interfaces is not among the common interfaces.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from std_srvs.srv import Trigger

from barc_sim.errors import UserError

if TYPE_CHECKING:
    from collections.abc import Callable

    from barc_sim.nodes.recorder.node import BagRecorder


def serve(recorder: BagRecorder) -> None:
    """Make the services; they call the recorder's methods, where it is spun."""

    def pause() -> str:
        recorder.paused = True
        return 'paused'

    def resume() -> str:
        recorder.paused = False
        return 'recording'

    def is_paused() -> str:
        return str(recorder.paused).lower()

    def split_bagfile() -> str:
        if recorder.stopped:
            raise UserError('nothing is being recorded: call record first')
        recorder.split()
        return str(recorder.path)

    def stop() -> str:
        recorder.close()
        return str(recorder.path)

    def record() -> str:
        if not recorder.stopped:
            raise UserError(f'{str(recorder.path)!r} is being recorded: call stop first')
        recorder.restart()
        return str(recorder.path)

    # Not `~/pause`: where one remapping renames all nodes, another node may have that.
    for action in (pause, resume, is_paused, split_bagfile, stop, record):
        recorder.create_service(Trigger, f'bag_recorder/{action.__name__}', _handler(action))


def _handler(action: Callable[[], str]) -> Callable[[Any, Any], Any]:
    def handle(_: Any, response: Any) -> Any:  # noqa: ANN401 (generated classes)
        try:
            response.message = action()
            response.success = True
        except UserError as error:
            response.message = str(error)
        return response

    return handle
