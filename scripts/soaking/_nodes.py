"""Nodes in processes of their own, which can be killed and started again."""

from __future__ import annotations

import signal
import subprocess
import sys
from typing import TYPE_CHECKING, Any

from barc_interfaces.msg import ZDynBkMdl
from geometry_msgs.msg import Twist, Vector3
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node

from barc_sim.interfaces import qos, topics
from barc_sim.interfaces.stamps import to_nanoseconds
from barc_sim.ros.peers import publishers

if TYPE_CHECKING:
    from pathlib import Path

_PARAMETERS = {
    'vehicle_simulator': ('-p', 'command_timeout:=0.5', '-p', 'road:=flat'),
    'bag_recorder': ('-p', 'bag_dir:=bags'),
}
_END_TIMEOUT = 20.0  #: [s]


class Nodes:
    """Processes, by the names of their nodes.

    Parameters
    ----------
    folder
        The nodes run in it; each one writes its output to a log there.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._running: dict[str, subprocess.Popen[bytes]] = {}

    def start(self, name: str) -> None:
        """Start a node."""
        command = [sys.executable, '-m', 'barc_sim', 'node', name, '--ros-args']
        with (self._folder / f'{name}.log').open('ab') as log:
            self._running[name] = subprocess.Popen(  # noqa: S603 (our own)
                [*command, *_PARAMETERS.get(name, ())],
                cwd=self._folder,
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=log,
            )

    def kill(self, name: str) -> None:
        """Kill a node."""
        process = self._running.pop(name)
        process.kill()
        process.wait()

    def is_alive(self, name: str) -> bool:
        """Return whether a node has not ended by itself."""
        return self._running[name].poll() is None

    def end(self) -> list[int]:
        """End all in order; return their exit codes."""
        for process in self._running.values():
            process.send_signal(signal.SIGINT)
        codes = [_exit_code(process) for process in self._running.values()]
        self._running.clear()
        return codes

    def logs(self) -> str:
        """Return the output of all nodes."""
        return '\n'.join(log.read_text(errors='replace') for log in self._folder.glob('*.log'))


def _exit_code(process: subprocess.Popen[bytes]) -> int:
    """Wait for the end of a process; kill it if it does not end."""
    try:
        return process.wait(_END_TIMEOUT)
    except subprocess.TimeoutExpired:
        process.kill()
        return process.wait()


class Witness(Node):
    """Observes the states, and publishes the driver's input to go ahead ten times a second."""

    def __init__(self) -> None:
        super().__init__('witness')
        self.speed = 0.0  #: [m/s]
        self.stamp = 0  #: [ns]
        self.states = 0

        self._twist_pub = self.create_publisher(Twist, topics.CMD_VEL, qos.DEFAULT)
        self.create_subscription(ZDynBkMdl, topics.STATE, self._on_state, qos.DEFAULT)
        self.create_timer(0.1, self._drive_ahead)

        self._executor: Any = SingleThreadedExecutor()
        self._executor.add_node(self)

    def _on_state(self, state: ZDynBkMdl) -> None:
        self.states += 1
        self.speed = state.v_x
        self.stamp = to_nanoseconds(state.header.stamp)

    def _drive_ahead(self) -> None:
        self._twist_pub.publish(Twist(linear=Vector3(x=1.0)))

    def sees_commands(self) -> bool:
        """Return whether a node publishes commands."""
        return bool(publishers(self, topics.ECU))

    def spin_once(self) -> None:
        """Process what has arrived."""
        self._executor.spin_once(timeout_sec=0.05)
