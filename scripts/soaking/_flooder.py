"""Floods the topics of a run; prints, as JSON, how many messages it sent in which time."""

from __future__ import annotations

import json
import random
import sys
import time
from itertools import cycle
from typing import Any

import rclpy
from _garbage import Garbage
from barc_interfaces.msg import ZDynBkMdl
from rclpy.serialization import serialize_message

from barc_sim.interfaces import qos, topics
from barc_sim.ros.process import ros
from barc_sim.ros.topics import message_class

#: By mode what a node of the run other than the recorder listens to, and its type.
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
_PATIENCE = 3.0  #: [s]


def main() -> None:
    """Flood with the task on the command line, in JSON."""
    task = json.loads(sys.argv[1])
    chance = random.Random(task['seed'])  # noqa: S311 (no secret)
    with ros([]):
        node = rclpy.create_node('flooder')
        _wait_for_states(node)
        garbage = Garbage(chance, time.time_ns())
        sends = []
        for topic, kind in TOPICS[task['mode']].items():
            publisher = node.create_publisher(message_class(kind), topic, qos.DEFAULT)
            pool = [
                serialize_message(garbage.of(kind, wild=chance.choice((False, True))))
                for _ in range(_POOL)
            ]
            sends.append((publisher, cycle(pool)))
        print(json.dumps(_flood(_matched(sends), task['rate'], task['seconds'])))


def _wait_for_states(node: rclpy.node.Node) -> None:
    """Wait until the run drives: before, it would refuse to start beside another simulator."""
    states: list[Any] = []
    subscription = node.create_subscription(ZDynBkMdl, topics.STATE, states.append, 100)
    while len(states) < _FIRST_STATES:
        rclpy.spin_once(node)
    node.destroy_subscription(subscription)


def _matched(sends: list[tuple[Any, Any]]) -> list[tuple[Any, Any]]:
    """Return those with a subscriber, after a wait for the subscribers of all."""
    end = time.monotonic() + _PATIENCE
    while time.monotonic() < end and not all(pub.get_subscription_count() for pub, _ in sends):
        time.sleep(0.01)
    return [send for send in sends if send[0].get_subscription_count()]


def _flood(sends: list[tuple[Any, Any]], rate: float, seconds: float) -> dict[str, float]:
    turns = cycle(sends)
    began = time.perf_counter()
    sent = 0
    while (passed := time.perf_counter() - began) < seconds:
        for _ in range(int(passed * rate) - sent):
            publisher, pool = next(turns)
            publisher.publish(next(pool))
            sent += 1
        time.sleep(_TICK)
    return {'sent': sent, 'seconds': time.perf_counter() - began}


if __name__ == '__main__':
    main()
