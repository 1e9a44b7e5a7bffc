"""The recorder: every topic's messages into a bag."""

from __future__ import annotations

import importlib
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rclpy.callback_groups import CallbackGroup
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
# Messages taken from a topic in one turn, about 10 ms of work: other callbacks have theirs then.
_BATCH = 1_000
# [s] between two turns.
_DRAIN_PERIOD = 0.05
# [s] between two looks for new topics, each of which ends a chunk: what is lost by a kill.
_LOOK_PERIOD = 0.2
_BAG_DIR = Parameter(
    'bag_dir', 'bags', 'folder to make the bag in, as a directory <date>_<time>', read_only=True
)


class _Polled(CallbackGroup):
    """Of subscriptions that no executor waits for: their messages are taken by a timer.

    To be woken for each message would cost 4 % of a core at 50 Hz with 7 topics, a look at all of
    them every 50 ms costs about 1 %; and nothing comes between a state and the command that
    answers it. Reception is stamped in DDS, so nothing is lost by looking later.
    """

    def can_execute(self, entity: object) -> bool:  # noqa: ARG002 (CallbackGroup's)
        """Keep the subscription out of the wait set."""
        return False

    def beginning_execution(self, entity: object) -> bool:  # noqa: ARG002 (CallbackGroup's)
        """Refuse."""
        return False

    def ending_execution(self, entity: object) -> None:
        """Do nothing, as nothing begins."""


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
        self._polled = _Polled()
        self._recordings: dict[str, _Recording] = {}
        self._unknown: dict[str, str] = {}
        self.discover()  # before the parameters are declared, to record their events

        default = str(directory or 'bags')
        root = declare(self, [_BAG_DIR._replace(default=default)])['bag_dir']
        self._writer = BagWriter(new_directory(Path(root)), metadata=metadata)
        self.path = self._writer.directory
        group = QuickCallbackGroup()
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        for period, callback in ((_DRAIN_PERIOD, self._drain), (_LOOK_PERIOD, self._look)):
            self.create_timer(period, callback, group, steady)
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
        for timer in self.timers:
            timer.cancel()
        self._drain(_DEPTH)
        if self._unknown:
            self.add_metadata({f'not recorded {name}': why for name, why in self._unknown.items()})
        self._writer.close()

    def destroy_node(self) -> None:
        """Close the bag and destroy the node."""
        self.close()
        super().destroy_node()

    def _look(self) -> None:
        self.discover()
        self._writer.flush()

    def _drain(self, limit: int = _BATCH) -> None:
        """Record what waits, up to `limit` messages of each topic."""
        for recording in self._recordings.values():
            self._take(recording, limit)

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
            self._take(recording, _DEPTH)
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
            lambda _: None,
            offers.request(publishers, _DEPTH),
            callback_group=self._polled,
            event_callbacks=SubscriptionEventCallbacks(use_default_callbacks=False),
            raw=True,
        )

    def _take(self, recording: _Recording, limit: int) -> None:
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
