"""Relays in the manner of students: functions, and programs of ROS 1 and ROS 2."""

from __future__ import annotations

import subprocess
import sys

from user_files import user_text

FUNCTION = """\
def relay(linear_x, angular_z):
    return [2.0 * linear_x, 0.3 * angular_z]
"""

CLASS = user_text('relay_class.py')

#: The lab's, for ROS 1: tabs, a loop at its own rate, the topic of the stock keyboard.
ROS_1 = user_text('relay_ros_1.py')

#: Publishes in the callback alone, as simple ones do.
CALLBACK = user_text('relay_callback.py')

ROS_2 = user_text('relay_ros_2.py')

#: Keyboard and relay in one node.
COMBINED = user_text('relay_with_keys.py')

#: Asks for full speed until the car has it.
_JOYSTICK = user_text('joystick.py')


def joystick() -> None:
    """Drive, from a process of its own, until the car moves."""
    subprocess.run([sys.executable, '-c', _JOYSTICK], check=True, timeout=200)
