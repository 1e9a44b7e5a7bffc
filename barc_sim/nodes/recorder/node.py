"""The recorder: the messages of every topic that is wanted, into a bag."""

from __future__ import annotations

import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.task import Future

from barc_sim.bags import losses
from barc_sim.bags.directory import make_directory, new_directory
from barc_sim.bags.writer import BagWriter, FileLimits
from barc_sim.cli.parser import call
from barc_sim.nodes.recorder import describing, disk_space
from barc_sim.nodes.recorder.options import Recording
from barc_sim.nodes.recorder.services import serve
from barc_sim.nodes.recorder.writer_thread import Pump
from barc_sim.ros.executor.executor import QuickCallbackGroup
from barc_sim.ros.parameters import declare
from barc_sim.ros.process import spin
from barc_sim.ros.topic_subscriptions import Listener
from barc_sim.vehicle.parameter import Parameter

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from rclpy.topic_endpoint_info import TopicEndpointInfo

# [s] between two looks for new topics.
_LOOK_PERIOD = 0.2
_BAG_DIR = Parameter(
    'bag_dir', 'bags', 'folder to make the bag in, as a directory <date>_<time>', read_only=True
)


class BagRecorder(Node):
    """Records the topics that are wanted and have a publisher, from its construction on.

    To be created before the other nodes of a process: within a participant, publishers and
    subscriptions match as they are created, so that what those nodes publish while they are being
    set up on `/rosout` and `/parameter_events` is recorded, too.

    Messages are written by a thread of its own; it is spun to find topics, and for its services:
    `bag_recorder/pause`, `resume`, `is_paused`, `split_bagfile`, `stop` and, for another bag in the
    folder, `record`.

    Parameters
    ----------
    directory
        Folder in which to make the bag's directory, `<date>_<time>`; the parameter `bag_dir`
        goes before it.
    recording
        What to record, and how.
    path
        The directory of the first bag itself, to be made; goes before the folder.
    metadata
        What the run says of itself, kept in the bag.
    attachments
        Files, by name, that each bag begins with.
    options
        Those of `rclpy.node.Node`.

    Raises
    ------
    UserError
        The bag cannot be made.
    """

    def __init__(
        self,
        directory: Path | None = None,
        recording: Recording | None = None,
        *,
        path: Path | None = None,
        metadata: Mapping[str, str] | None = None,
        attachments: Mapping[str, bytes] | None = None,
        **options: Any,  # noqa: ANN401 (Node's own)
    ) -> None:
        super().__init__('bag_recorder', **options)
        #: Done when writing has failed, where that is to stop the run.
        self.finished: Future = Future()
        self.failure: str | None = None  #: what went wrong first, in a sentence
        self._recording = recording or Recording()
        self._use_sim_time = self._recording.use_sim_time
        self._metadata = dict(metadata or {})
        self._attachments = dict(attachments or {})
        self._listen()  # before the parameters are declared, to record their events
        default = str(directory or 'bags')
        self._root = Path(declare(self, [_BAG_DIR._replace(default=default)])['bag_dir'])
        self.start(path)
        self.create_timer(
            _LOOK_PERIOD,
            self.discover,
            QuickCallbackGroup(),
            Clock(clock_type=ClockType.STEADY_TIME),
        )
        serve(self)

    def _listen(self) -> None:
        self._listener = Listener(self, self._recording.wants)
        self.discover()

    def start(self, path: Path | None = None) -> None:
        """Begin a bag, in the directory `path`; without it, in the folder for bags.

        Raises
        ------
        UserError
            The bag cannot be made.
        """
        reserve = self._recording.reserve
        disk_space.check(path or self._root, reserve)
        self.path = make_directory(path) if path else new_directory(self._root)
        limits = FileLimits(self._recording.max_bag_size, self._recording.max_bag_duration)
        self._writer = BagWriter(self.path, metadata=self._metadata, limits=limits)
        self._pump = Pump(self._writer, self._listener.take, reserve, self._on_failure)
        self._pump.attach(self._attachments)
        self._pump.use_sim_time = self.use_sim_time
        self._pump.start()
        self.get_logger().info(f'recording to {str(self.path)!r}')

    def _on_failure(self, failure: str | None) -> None:
        if failure is None:
            self.get_logger().warning(f'recording to {str(self.path)!r} goes on')
            return
        self.failure = self.failure or failure
        self.get_logger().error(failure)
        if self._recording.on_write_error == 'stop' and not self.finished.done():
            self.finished.set_result(None)

    @property
    def counts(self) -> dict[str, int]:
        """Number of messages recorded, by topic."""
        return dict(self._writer.counts)

    @property
    def lost(self) -> dict[str, dict[str, int] | None]:
        """Messages lost, by topic and publishing node; None for a topic where that is unknown."""
        return self._listener.lost()

    @property
    def paused(self) -> bool:
        """Whether messages are left out of the bag for now."""
        return self._pump.paused

    @paused.setter
    def paused(self, paused: bool) -> None:
        self._pump.paused = paused

    @property
    def use_sim_time(self) -> bool:
        """Whether the bag's time is that of `/clock`, as soon as it is heard."""
        return self._use_sim_time

    @use_sim_time.setter
    def use_sim_time(self, use: bool) -> None:
        self._use_sim_time = self._pump.use_sim_time = use

    @property
    def stopped(self) -> bool:
        """Whether the bag is finished."""
        return self._writer.closed

    def split(self) -> None:
        """Go on in the bag's next file."""
        self._pump.split()

    def add_metadata(self, entries: Mapping[str, str]) -> None:
        """Keep in the bag what the run says of itself; replaces entries of the same name."""
        self._metadata.update(entries)
        self._pump.add_metadata(entries)

    def discover(self) -> None:
        """Listen to every wanted topic that has a publisher by now, as far as not done yet."""
        for name, publishers in self._listener.discover():
            self._ask(name, publishers)

    def _ask(self, name: str, publishers: Sequence[TopicEndpointInfo]) -> None:
        """Ask for a definition that is missing; warn where none is to be had."""

        def answered(definition: str | None) -> None:
            if definition:
                self._listener.define(publishers[0].topic_type, definition)
            if not (definition and self._listener.hear(name, publishers)):
                why = self._listener.unknown[name]
                self.get_logger().warning(f'{name} is not recorded: {why}')

        describing.ask(self, publishers, answered)

    def close(self) -> None:
        """Record what is waiting and finish the bag; a second call does nothing."""
        while not self.stopped and self._listener.expects_latched:
            time.sleep(0.01)
        self._pump.close(self._last_words)

    def _last_words(self) -> dict[str, str]:
        unknown = self._listener.unknown
        return {
            **{f'not recorded {name}': why for name, why in unknown.items()},
            **losses.as_metadata(self.lost),
        }

    def restart(self) -> None:
        """Begin the next bag, after `close`.

        Raises
        ------
        UserError
            It cannot be made.
        """
        self._listener.close()
        self._listen()  # latched messages come again
        self.start()

    def destroy_node(self) -> None:
        """Close the bag and destroy the node."""
        self.close()
        self._listener.close()
        super().destroy_node()


def main(args: list[str] | None = None) -> int:
    """Run the node alone, until it is told to stop."""
    return call('bag_recorder', lambda: spin(BagRecorder, args))


if __name__ == '__main__':
    sys.exit(main())
