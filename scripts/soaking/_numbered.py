"""Publishes numbered messages at a steady rate until it is terminated.

The task on the command line, in JSON, has the number of `topics`, the `rate` of all together [1/s],
and the `size` of a message [B]. zstd cannot compress the messages.
"""

from __future__ import annotations

import json
import os
import sys
import time
from struct import Struct

import rclpy
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from std_msgs.msg import UInt8MultiArray

#: A message's beginning in CDR: encapsulation, no dimensions, no offset, the number of bytes, of
#: which the first are the message's own number.
HEAD = Struct('<4sIIIQ')
_LITTLE_ENDIAN = bytes([0, 1, 0, 0])
_NOISE = 1 << 20  #: [B]
#: [s] between two bursts.
_PERIOD = 0.002


def main() -> None:
    """Publish as in the task."""
    task = json.loads(sys.argv[1])
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    node = Node('numbered')
    publishers = [
        node.create_publisher(UInt8MultiArray, f'numbered_{index}', 1000)
        for index in range(task['topics'])
    ]
    noise = os.urandom(_NOISE)
    length = task['size'] - HEAD.size

    start = time.perf_counter()
    sent = 0
    while True:
        due = int((time.perf_counter() - start) * task['rate'])
        for index in range(sent, due):
            number, place = divmod(index, len(publishers))
            head = HEAD.pack(_LITTLE_ENDIAN, 0, 0, length + 8, number)
            offset = index * 997 % (_NOISE - length)
            publishers[place].publish(head + noise[offset : offset + length])
        sent = due
        time.sleep(_PERIOD)


if __name__ == '__main__':
    main()
