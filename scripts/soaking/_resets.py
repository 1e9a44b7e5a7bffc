"""Drives in lock-step and resets, again and again; prints, as JSON, a digest of each drive."""

from __future__ import annotations

import hashlib
import json
import struct
import sys
import time
from typing import TYPE_CHECKING

from _figures import memory
from rclpy.node import Node
from rclpy.parameter import Parameter
from std_srvs.srv import Trigger

from barc_sim.interfaces import services
from barc_sim.nodes.controller import CruiseController
from barc_sim.nodes.simulator import VehicleSimulator
from barc_sim.ros.executor import QuickExecutor
from barc_sim.ros.process import NUM_THREADS, ros

if TYPE_CHECKING:
    from barc_sim.vehicle.plant import Observation

_STATES = 100  #: of a drive
#: All that has a memory is in it: noise, lags and delays, the integrator.
_PARAMETERS = {
    'realtime_factor': 0.0,
    'seed': 3,
    'noise_v_x': 0.05,
    'noise_psi_dot': 0.01,
    'motor_lag': 0.1,
    'servo_delay': 0.05,
}


class _Drives(Node):
    """Calls the reset service after so many states."""

    def __init__(self, resets: int) -> None:
        super().__init__('drives')
        self.digests: list[str] = []
        self.seconds: list[float] = []
        self.memory: list[int] = []  #: [bytes]
        self._resets_left = resets
        self._reset_time = time.perf_counter()
        self._begin()

        self.simulator = VehicleSimulator(
            on_step=self._on_step,
            parameter_overrides=[
                Parameter(name, value=value) for name, value in _PARAMETERS.items()
            ],
        )
        self._reset_client = self.create_client(Trigger, services.RESET_SIMULATOR)

    def _on_step(self, t: float, observation: Observation) -> None:
        if t == 0.0:
            self._begin()
        self._states += 1
        if self._states > _STATES:  # until the reset is done
            return

        values = (*observation.true, *observation.measured, *observation.acting)
        self._hash.update(struct.pack(f'{len(values)}d', *values))
        if self._states == _STATES:
            self._end()

    def _begin(self) -> None:
        self._states = 0
        self._hash = hashlib.sha256()

    def _end(self) -> None:
        now = time.perf_counter()
        self.digests.append(self._hash.hexdigest())
        self.seconds.append(now - self._reset_time)
        self.memory.append(memory())

        if not self._resets_left:
            self.simulator.finish()
            return
        self._resets_left -= 1
        self._reset_time = now
        self._reset_client.call_async(Trigger.Request())


def main() -> None:
    """Reset as many times as the command line names."""
    with ros([]):
        drives = _Drives(int(sys.argv[1]))
        nodes: list[Node] = [drives, drives.simulator, CruiseController()]
        executor = QuickExecutor(num_threads=NUM_THREADS)
        for node in nodes:
            executor.add_node(node)
        executor.spin_until_future_complete(drives.simulator.finished)

        executor.shutdown()
        for node in nodes:
            node.destroy_node()
    print(
        json.dumps({'digests': drives.digests, 'seconds': drives.seconds, 'memory': drives.memory})
    )


if __name__ == '__main__':
    main()
