"""Call services of rosbag2's recorder or player, as any of its clients; print the responses.

`rosbag2_client.py NODE SERVICE...`; the word `event` waits for the message of a split instead.
"""

from __future__ import annotations

import re
import sys
from typing import Any

import rclpy
from rosbag2_interfaces import srv
from rosbag2_interfaces.msg import WriteSplitEvent


def class_name(service: str) -> str:
    """Return the name of a service's type, such as `IsPaused` of `is_paused`."""
    return re.sub('(?:^|_)([a-z])', lambda match: match[1].upper(), service)


rclpy.init()
node = rclpy.create_node('client')
events: list[WriteSplitEvent] = []
node.create_subscription(WriteSplitEvent, 'events/write_split', events.append, 10)

owner, *names = sys.argv[1:]
for name in names:
    if name == 'event':
        while not events:
            rclpy.spin_once(node)
        event = events.pop()
        print(event.node_name, event.closed_file, event.opened_file)
        continue

    service = getattr(srv, class_name(name))
    client = node.create_client(service, f'/{owner}/{name}')
    client.wait_for_service()
    future = client.call_async(service.Request())
    rclpy.spin_until_future_complete(node, future)
    response: Any = future.result()
    fields = [field for field in response.get_fields_and_field_types() if 'needs' not in field]
    print(name, *(f'{field}={getattr(response, field)}' for field in fields))
