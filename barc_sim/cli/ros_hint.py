"""The sentence for what needs ROS where there is none: what to install, by system."""

from __future__ import annotations

import sys
from importlib.util import find_spec

from barc_sim.errors import UserError

#: The packages without which nothing of ROS works here.
ROS_PACKAGES = ('rclpy', 'barc_interfaces')
_HOW = {
    'win32': 'install WSL 2 (wsl --install), and start ./scripts/run in its Ubuntu',
    'darwin': 'install RoboStack (pixi shell in the checkout), or use a container of ros:jazzy',
}
_HOW_ON_LINUX = (
    'start with ./scripts/run on x86-64; or, on Ubuntu 24.04, install ROS 2 Jazzy '
    '(sudo apt install ros-jazzy-ros-base) and source it; else use a container of ros:jazzy'
)


def _is_installed(package: str) -> bool:
    try:
        spec = find_spec(package)
    except ImportError:
        return False
    # Without an origin it is no more than a folder of that name, as a checkout has.
    return spec is not None and spec.origin is not None


def has_ros() -> bool:
    """Return whether this Python has rclpy and the lab's messages."""
    return all(map(_is_installed, ROS_PACKAGES))


def needs_ros(what: str) -> UserError:
    """Return the error that `what` needs ROS, with what to install on this system."""
    return UserError(f'{what} needs ROS 2: {_HOW.get(sys.platform, _HOW_ON_LINUX)}')
