"""Floods the topics of a run; prints, as JSON, the number of its messages and the time."""

from __future__ import annotations

import json
import random
import sys
import time
from itertools import cycle
from typing import TYPE_CHECKING, Any, NamedTuple

import rclpy
from _garbage import Garbage
from barc_interfaces.msg import ZDynBkMdl
from rclpy.serialization import serialize_message

from barc_sim.interfaces import qos, topics
from barc_sim.ros.process import ros
from barc_sim.ros.topics import message_class

if TYPE_CHECKING:
    from collections.abc import Iterator

#: By mode, the topics with a subscriber other than the recorder, and their types.
TOPICS = {
    'acc': {
        topics.ECU: 'barc_interfaces/msg/ECU',
        topics.STATE: 'barc_interfaces/msg/ZDynBkMdl',
        topics.STATE_ERROR: 'barc_interfaces/msg/EZDynBkMdl',
        topics.ENVIRONMENT: 'barc_interfaces/msg/Environment',
        topics.PID_STATE: 'barc_interfaces/msg/PidState',
        topics.SPEED_REFERENCE: 'std_msgs/msg/Float64',
        '/parameter_events': 'rcl_interfaces/msg/ParameterEvent',
    },
    'teleop': {
        topics.ECU: 'barc_interfaces/msg/ECU',
        topics.STATE: 'barc_interfaces/msg/ZDynBkMdl',
        topics.CMD_VEL: 'geometry_msgs/msg/Twist',
        '/parameter_events': 'rcl_interfaces/msg/ParameterEvent',
    },
}
_POOL = 1000  #: different messages of a topic
#: [s] between two bursts.
_TICK = 0.002
_FIRST_STATES = 50
_MATCH_TIMEOUT = 3.0  #: [s]


class _Sender(NamedTuple):
    """Publishes the messages of a topic, again and again."""

    publisher: Any
    messages: Iterator[bytes]

    def publish(self) -> None:
        self.publisher.publish(next(self.messages))

    def has_subscriber(self) -> bool:
        return bool(self.publisher.get_subscription_count())


def main() -> None:
    """Flood with the task on the command line, in JSON."""
    task = json.loads(sys.argv[1])
    with ros([]):
        node = rclpy.create_node('flooder')
        _wait_for_states(node)

        senders = _senders(node, task['mode'], task['seed'])
        print(json.dumps(_flood(_connected_senders(senders), task['rate'], task['seconds'])))


def _wait_for_states(node: rclpy.node.Node) -> None:
    """Wait until the run drives: before, it would refuse to start beside another simulator."""
    states: list[Any] = []
    subscription = node.create_subscription(ZDynBkMdl, topics.STATE, states.append, 100)
    while len(states) < _FIRST_STATES:
        rclpy.spin_once(node)
    node.destroy_subscription(subscription)


def _senders(node: rclpy.node.Node, mode: str, seed: int) -> list[_Sender]:
    """Return a sender for each topic of a mode."""
    chance = random.Random(seed)  # noqa: S311 (no secret)
    garbage = Garbage(chance, time.time_ns())
    senders = []
    for topic, type_name in TOPICS[mode].items():
        publisher = node.create_publisher(message_class(type_name), topic, qos.DEFAULT)
        pool = []
        for _ in range(_POOL):
            message = garbage.message(type_name, wild=chance.choice((False, True)))
            pool.append(serialize_message(message))

        senders.append(_Sender(publisher, cycle(pool)))
    return senders


def _connected_senders(senders: list[_Sender]) -> list[_Sender]:
    """Return those with a subscriber, after a wait for the subscribers of all."""
    deadline = time.monotonic() + _MATCH_TIMEOUT
    while time.monotonic() < deadline:
        if all(sender.has_subscriber() for sender in senders):
            break
        time.sleep(0.01)

    return [sender for sender in senders if sender.has_subscriber()]


def _flood(senders: list[_Sender], rate: float, seconds: float) -> dict[str, float]:
    turns = cycle(senders)
    count = 0
    elapsed = 0.0
    start = time.perf_counter()

    while elapsed < seconds:
        for _ in range(int(elapsed * rate) - count):
            next(turns).publish()
            count += 1

        time.sleep(_TICK)
        elapsed = time.perf_counter() - start
    return {'messages': count, 'seconds': elapsed}


if __name__ == '__main__':
    main()
