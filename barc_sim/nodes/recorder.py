"""The recorder: every topic's messages into a bag."""

from __future__ import annotations

import importlib
import sys
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rclpy.clock import Clock, ClockType
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.node import Node

from barc_sim import offers
from barc_sim.bag_directory import new_directory
from barc_sim.bag_writer import BagWriter
from barc_sim.cli import call
from barc_sim.executor import QuickCallbackGroup
from barc_sim.parameters import Parameter, declare
from barc_sim.process import spin

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from rclpy.subscription import Subscription
    from rclpy.topic_endpoint_info import TopicEndpointInfo

    from barc_sim.bag_writer import Topic

# Messages that may wait: what a stall of a second brings at 10,000 a second.
_DEPTH = 10_000
# Messages taken in one callback, so that other callbacks have their turn.
_BATCH = 1_000
# [s] between looks for new topics, each ending a chunk: what is lost if the process is killed.
_PERIOD = 0.2

_BAG_DIR = Parameter(
    'bag_dir', 'bags', 'folder to make the bag in, as a directory <date>_<time>', read_only=True
)


@dataclass
class _Recording:
    topic: Topic
    publishers: int  # that its quality of service fits
    subscription: Subscription
    channel: int | None = None  # in the bag, from the first message on


class BagRecorder(Node):
    """Records every topic that has a publisher, hidden ones apart, from its construction on.

    To be created before the other nodes of a process: within a participant, publishers and
    subscriptions match as they are created, so that what those nodes publish while they are being
    set up on `/rosout` and `/parameter_events` is recorded, too. The messages wait in the
    subscriptions until the node is spun or closed.

    Parameters
    ----------
    directory
        Folder in which to make the bag's directory, `<date>_<time>`; the parameter `bag_dir`
        goes before it.
    metadata
        What the run says of itself, kept in the bag.
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
        *,
        metadata: Mapping[str, str] | None = None,
        **options: Any,  # noqa: ANN401 (Node's own)
    ) -> None:
        super().__init__('bag_recorder', **options)
        self._group = QuickCallbackGroup()
        self._recordings: dict[str, _Recording] = {}
        self._unknown: dict[str, str] = {}
        self.discover()  # before the parameters are declared, to record their events

        default = str(directory or 'bags')
        root = declare(self, [_BAG_DIR._replace(default=default)])['bag_dir']
        self._writer = BagWriter(new_directory(Path(root)), metadata=metadata)
        self.path = self._writer.directory
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._timer = self.create_timer(_PERIOD, self._tick, self._group, steady)
        self.get_logger().info(f'recording to {str(self.path)!r}')

    @property
    def counts(self) -> dict[str, int]:
        """Number of messages recorded, by topic."""
        return self._writer.counts

    def add_metadata(self, entries: Mapping[str, str]) -> None:
        """Keep in the bag what the run says of itself; replaces entries of the same name."""
        self._writer.add_metadata(entries)

    def discover(self) -> None:
        """Subscribe to every topic that has a publisher by now, as far as not done yet."""
        for name, _ in self.get_topic_names_and_types():
            hidden = '/_' in name
            publishers = self.count_publishers(name)
            recording = self._recordings.get(name)
            known = recording.publishers if recording else 0
            if not hidden and publishers != known and name not in self._unknown:
                self._follow(name, recording)

    def close(self) -> None:
        """Record what is waiting and finish the bag; a second call does nothing."""
        if self._writer.closed:
            return
        self._timer.cancel()
        for recording in self._recordings.values():
            self._drain(recording, _DEPTH)
        if self._unknown:
            self.add_metadata({f'not recorded {name}': why for name, why in self._unknown.items()})
        self._writer.close()

    def destroy_node(self) -> None:
        """Close the bag and destroy the node."""
        self.close()
        super().destroy_node()

    def _tick(self) -> None:
        self.discover()
        self._writer.flush()

    def _follow(self, name: str, recording: _Recording | None) -> None:
        """Subscribe so that all publishers which the topic has now are heard."""
        publishers = self.get_publishers_info_by_topic(name)
        if recording:
            recording.publishers = len(publishers)
            if all(
                offers.fits(publisher, recording.subscription.qos_profile)
                for publisher in publishers
            ):
                return
            self._drain(recording, _DEPTH)
            self.destroy_subscription(recording.subscription)
            recording.subscription = self._subscribe(name, publishers)
        elif publishers:
            try:
                topic = offers.describe(name, publishers)
                subscription = self._subscribe(name, publishers)
            except (ImportError, AttributeError, LookupError) as error:
                self._unknown[name] = f'{publishers[0].topic_type}: {error}'
                self.get_logger().warning(f'{name} is not recorded: {self._unknown[name]}')
            else:
                self._recordings[name] = _Recording(topic, len(publishers), subscription)

    def _subscribe(self, name: str, publishers: Sequence[TopicEndpointInfo]) -> Subscription:
        package, module, base = publishers[0].topic_type.split('/')
        return self.create_subscription(
            getattr(importlib.import_module(f'{package}.{module}'), base),
            name,
            partial(self._receive, name),
            offers.request(publishers, _DEPTH),
            callback_group=self._group,
            event_callbacks=SubscriptionEventCallbacks(use_default_callbacks=False),
            raw=True,
        )

    def _receive(self, name: str, data: bytes, info: dict[str, int]) -> None:
        if self._writer.closed:
            return
        recording = self._recordings[name]
        self._write(recording, data, info)
        # Each return to the executor costs more than ten messages taken here.
        self._drain(recording, _BATCH)

    def _drain(self, recording: _Recording, limit: int) -> None:
        """Record what waits in a subscription, up to `limit` messages."""
        subscription = recording.subscription
        with subscription.handle:
            for _ in range(limit):
                taken = subscription.handle.take_message(subscription.msg_type, True)
                if taken is None:
                    return
                self._write(recording, *taken)

    def _write(self, recording: _Recording, data: bytes, info: dict[str, int]) -> None:
        if recording.channel is None:
            recording.channel = self._writer.add_topic(recording.topic)
        self._writer.write(
            recording.channel,
            data,
            received=info['received_timestamp'],
            published=info['source_timestamp'],
            sequence=info['publication_sequence_number'],
        )


def main(args: list[str] | None = None) -> int:
    """Run the node alone, until it is told to stop."""
    return call('bag_recorder', lambda: spin(BagRecorder, args))


if __name__ == '__main__':
    sys.exit(main())
