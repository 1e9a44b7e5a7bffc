"""The node `bag_recorder`: records every selected topic into a bag.

How a message comes into the bag; the arrows are the way of the message::

    with ROS                                       without ROS
    --------                                       -----------
    publisher                                      publisher, in its thread
       |  DDS                                         |
       v                                              v
    subscription without a callback                _RecordedSubscription.offer
    (polled.subscribe)                                |
       |  rcl, by Taker.take                          |
       v                                              v
    RecordedTopic.take                             a queue that all topics share
       |  each message once; counts losses            |
       v                                              v
    TopicSubscriptions.take                        LocalSubscriptions.take
    (ros/recording)                                (ros/local/recording.py)
       |                                              |
       +----------------------+-----------------------+
                              |  every 0.1 s, in a thread of the recorder
                              v
                        WriterThread: sorts by reception, applies `/clock`
                        (bags/writer_thread.py)
                              |  cache in memory (bags/cache.py), to another thread
                              v
                        BagWriter.write: splits the bag (bags/writer.py)
                              |
                              v
                        McapFileWriter: chunks of a file (bags/mcap_writer.py)

The carrier of the run makes the subscriptions (`Carrier.new_subscriptions`). Without ROS, a
publisher also writes in its own thread when the queue is long (`call_when_full`). An executor spins
this node only for its timer, which discovers topics, and for its services.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.task import Future
from std_srvs.srv import Trigger

from barc_sim.bags.directory import check_space, make_directory
from barc_sim.bags.losses import Missing
from barc_sim.bags.recording_settings import BAG_DIR, Recording
from barc_sim.bags.writer import BagWriter
from barc_sim.bags.writer_thread import WriterThread
from barc_sim.errors import UserError
from barc_sim.interfaces import services
from barc_sim.interfaces.topics import CLOCK, MESSAGE_TYPES
from barc_sim.ros.carrier import find_carrier
from barc_sim.ros.parameters import declare
from barc_sim.ros.peers import node_graph

if TYPE_CHECKING:
    from collections.abc import Mapping

    from barc_sim.ros.carrier import Carrier
#: [s] between two searches for new topics.
_DISCOVERY_PERIOD = 0.2


class BagRecorder(Node):
    """Records the selected topics that have a publisher, beginning in its constructor.

    Create it before the other nodes of a process: publishers and subscriptions of one participant
    match at their creation, so that `/rosout` and `/parameter_events` are recorded from the other
    nodes' constructors on.

    A thread of its own writes the messages. Spinning the node discovers topics, and serves
    `bag_recorder/pause`, `resume`, `split_bagfile` and `snapshot`, of the type Trigger.

    UserError: the bag cannot be made.

    Parameters
    ----------
    directory
        Folder in which to make the bag's directory, `<date>_<time>`; the parameter `bag_dir`
        overrides it.
    recording
        What to record, and how.
    path
        The new bag's directory itself; overrides `directory`.
    metadata
        The run's metadata, stored in the bag.
    carrier
        What carries the messages; by default, what carries those of this process.
    options
        Options of `rclpy.node.Node`.

    Examples
    --------
    >>> import rclpy
    >>> from std_msgs.msg import String
    >>> rclpy.init()
    >>> recorder, writer = BagRecorder(path=Path('notes')), rclpy.create_node('writer')
    >>> publisher = writer.create_publisher(String, 'note', 1)
    >>> recorder.discover()
    >>> publisher.publish(String(data='the road is wet'))
    >>> recorder.destroy_node()
    >>> recorder.counts['/note']
    1
    >>> writer.destroy_node()
    >>> rclpy.shutdown()
    """

    def __init__(
        self,
        directory: Path | None = None,
        recording: Recording | None = None,
        *,
        path: Path | None = None,
        metadata: Mapping[str, str] | None = None,
        carrier: Carrier | None = None,
        **options: Any,  # noqa: ANN401 (Node's own)
    ) -> None:
        super().__init__('bag_recorder', **options)
        recording = recording or Recording()
        carrier = carrier or find_carrier()

        self.finished: Future = Future()  #: done when writing has failed, and by `stop`
        self.failure: str | None = None  #: the first failure to write, in a sentence
        self._own_name = self.get_name()  # also needed after the node is destroyed
        self._metadata = dict(metadata or {})
        self.takes_snapshots = recording.snapshot_mode
        self._graph_size = 0  # number of nodes and topics in the bag's graph
        self._is_announced = False

        # Before the parameters are declared, to record their events.
        self._source = carrier.new_subscriptions(self, recording)
        self.discover()

        bag_dir = BAG_DIR._replace(default=str(directory or 'bags'))
        root = Path(declare(self, [bag_dir])['bag_dir'])

        check_space(path or root, recording.reserve)
        self._writer = BagWriter(
            make_directory(path, root),
            metadata=self._metadata,
            file_format=recording.file_format,
            max_size=recording.max_bag_size,
            max_duration=recording.max_bag_duration,
        )

        needs_cache = recording.snapshot_mode or not self._source.is_unlimited
        self._thread = WriterThread(
            self._writer,
            self._source.take,
            recording.reserve,
            self._on_failure,
            cache_size=recording.max_cache_size if needs_cache else 0,
            snapshot_mode=recording.snapshot_mode,
            on_warning=self._on_warning,
        )
        # Settings, before it starts.
        self._thread.paused = recording.start_paused
        self._thread.use_sim_time = recording.use_sim_time
        self._thread.waits_for_clock = recording.use_sim_time
        self._thread.writes_clock = recording.wants(CLOCK, [MESSAGE_TYPES[CLOCK]])

        self._source.call_when_full(self._thread.write_now)
        self._thread.start()

        # Not `~/pause`: a remapping that renames all nodes would give several of them that service.
        self.create_service(Trigger, services.PAUSE_RECORDER, self._on_pause)
        self.create_service(Trigger, services.RESUME_RECORDER, self._on_resume)
        self.create_service(Trigger, services.SPLIT_RECORDER, self._on_split)
        self.create_service(Trigger, services.SNAPSHOT_RECORDER, self._on_snapshot)

        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(_DISCOVERY_PERIOD, self._on_timer, clock=steady)

    def _on_timer(self) -> None:
        self.announce()
        if not self._writer.closed:
            self.discover()
            self._add_graph()

    def announce(self) -> None:
        """Log the bag's path, once; a run calls this when all its nodes have been made."""
        if not self._is_announced:
            self._is_announced = True
            self.get_logger().info(f'recording to {str(self.path)!r}{self._beginning}')

    @property
    def _beginning(self) -> str:
        """When the first message is written, as the end of a sentence."""
        if self._thread.paused:
            return ', once it is resumed'
        if self.takes_snapshots:
            return ', at each snapshot'
        if self._thread.waits_for_clock:
            return ', from the first message on /clock'
        return ''

    def _add_graph(self) -> None:
        """Add the graph to the bag whenever it has grown, unless the run adds it."""
        if 'graph' in self._metadata:
            return

        size = len(self.get_node_names()) + len(self.get_topic_names_and_types())
        if size > self._graph_size:
            self._graph_size = size
            graph = node_graph(self).to_json()
            self._thread.do(lambda writer: writer.add_metadata({'graph': graph}))

    def expect(self, topics: Mapping[str, str]) -> None:
        """Record topics even before they have a publisher; `topics` has their types by name.

        Call it before the nodes that subscribe to them are created: a publisher that waits for a
        subscription may send one message and end.
        """
        for name, type_name in topics.items():
            self._source.expect(self.resolve_topic_name(name), type_name)

    def _on_warning(self, warning: str) -> None:
        self.get_logger().warning(warning)

    def _on_failure(self, failure: str) -> None:
        self.get_logger().error(failure)
        if self.failure is None:
            self.failure = failure
            self.stop()

    @property
    def path(self) -> Path:
        """The directory of the bag."""
        return self._writer.directory

    @property
    def files(self) -> list[Path]:
        """The files of the bag, in order."""
        return self._writer.files

    @property
    def counts(self) -> dict[str, int]:
        """Number of messages in the bag's files, by topic."""
        return self._writer.on_disk

    @property
    def missing(self) -> Missing:
        """The messages that the bag is known to lack.

        A message that could not be written counts as lost by the recorder.
        """
        lost = self._source.lost()
        for topic, count in self._thread.unwritten.items():
            lost[topic] = lost.get(topic, {}) | {self._own_name: count}
        return Missing(
            lost=lost,
            unknown=self._source.unknown(),
            left_out=dict(self._source.left_out),
            before_clock=self._thread.before_clock,
        )

    @property
    def summary(self) -> str:
        """Lines with the numbers of recorded and lost messages, and what is left out."""
        return self.missing.summary(self.counts, len(self.files))

    @property
    def is_paused(self) -> bool:
        """Whether messages are left out."""
        return self._thread.paused

    def pause(self) -> None:
        """Leave out the messages from now on, until `resume`."""
        self._thread.pause()

    def resume(self) -> None:
        """Record again, from the next message on."""
        self._thread.resume()

    def toggle_pause(self) -> None:
        """Pause or resume."""
        if self.is_paused:
            self.resume()
        else:
            self.pause()

    def split(self) -> None:
        """End the file, and begin the next one.

        Raises
        ------
        UserError
            The disk refuses that now. The next file begins once the disk accepts data again.
        """
        self._thread.split()

    def snapshot(self) -> bool:
        """Write the messages that are in memory; return False without snapshot mode."""
        return self._thread.snapshot()

    def stop(self) -> None:
        """End the recording: `finished` is done."""
        if not self.finished.done():
            self.finished.set_result(None)

    def on_key(self, key: str) -> None:
        """Handle a key: `space` pauses or resumes, and `quit` ends."""
        if key == 'space':
            self.toggle_pause()
            self.get_logger().info('paused' if self.is_paused else 'resumed')
        elif key == 'quit':
            self.stop()

    def stamp_with_clock(self) -> None:
        """Stamp messages with `/clock`, once there is one; earlier messages keep their time."""
        self._thread.use_sim_time = True

    def add_metadata(self, entries: Mapping[str, str]) -> None:
        """Add metadata of the run to the bag; an entry replaces one of the same name."""
        self._metadata.update(entries)
        self._thread.do(lambda writer: writer.add_metadata(entries))

    def attach(self, files: Mapping[str, bytes]) -> None:
        """Attach text files to the bag, by name."""
        self._thread.do(lambda writer: writer.attach(files))

    def discover(self) -> None:
        """Subscribe to each selected topic with a new publisher since the last call."""
        self._source.discover()

    def close(self) -> None:
        """Record the waiting messages and finish the bag; a second call does nothing."""
        if not self._writer.closed:
            self._add_graph()
        self._thread.close(self._losses)
        self._source.close()

    def _losses(self) -> dict[str, str]:
        """Return the entries of the bag's metadata about missing messages."""
        return self.missing.as_metadata()

    def destroy_node(self) -> None:
        """Close the bag and destroy the node."""
        self.close()
        super().destroy_node()

    def _on_pause(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        self.pause()
        response.success = True
        response.message = 'paused'
        return response

    def _on_resume(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        self.resume()
        response.success = True
        response.message = 'recording'
        return response

    def _on_split(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        try:
            self.split()
        except UserError as error:
            response.message = str(error)
        else:
            response.success = True
            response.message = f'recording to {str(self.files[-1])!r}'
        return response

    def _on_snapshot(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        response.success = self.snapshot()
        if response.success:
            response.message = 'the messages in memory are written'
        else:
            response.message = 'all messages are written at once: record with --snapshot-mode'
        return response
