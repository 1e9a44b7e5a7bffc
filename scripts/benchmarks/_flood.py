"""Publishes at a steady rate, once its topics have subscribers; prints the number of messages."""

from __future__ import annotations

import json
import os
import sys
import time

import rclpy
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.serialization import serialize_message
from std_msgs.msg import UInt8MultiArray

#: Headers of CDR and of the type, which the size includes.
_HEADERS = 16


def main() -> None:
    """Publish as in the task on the command line, in JSON."""
    task = json.loads(sys.argv[1])
    rclpy.init()
    node = Node('flood')
    publishers = [
        node.create_publisher(UInt8MultiArray, f'flood_{number}', 10_000)
        for number in range(task['topics'])
    ]

    while not all(publisher.get_subscription_count() for publisher in publishers):
        time.sleep(0.01)
    time.sleep(0.5)  # the other side may not have matched yet

    data = os.urandom(max(task['size'] - _HEADERS, 0))
    message = serialize_message(UInt8MultiArray(data=data))
    total = task['rate'] * task['seconds']
    start = time.perf_counter()
    for number in range(total):
        for publisher in publishers:
            publisher.publish(message)

        wait = start + number / task['rate'] - time.perf_counter()
        if wait > 0.001:  # noqa: PLR2004 (what a sleep can do)
            time.sleep(wait)

    for publisher in publishers:
        publisher.wait_for_all_acked(Duration(seconds=30))
    print(total * len(publishers))
    rclpy.shutdown()


if __name__ == '__main__':
    main()
