"""Who is there to hear a simulator and to command it, and what keeps them from it."""

from __future__ import annotations

from typing import TYPE_CHECKING

from barc_sim.ros import names
from barc_sim.ros.endpoints import incompatible_peers
from barc_sim.ros.peers import living_publishers

if TYPE_CHECKING:
    from rclpy.node import Node

    from barc_sim.nodes.simulator.publishers import StateOutlet


class PeerWatch:
    """Says once what keeps a simulator from hearing or being heard.

    Who begins to command while time waits for the answer to a state is sent that state again.
    """

    def __init__(self, node: Node, outlet: StateOutlet) -> None:
        """Watch the peers of `node`, whose states go out by `outlet`."""
        self._node = node
        self._outlet = outlet
        self._steps = 0
        self._warned: set[str] = set()
        # Who commands, as of the latest look, and as of the one before the present state.
        self._commanders: set[bytes] = set()
        self._asked: set[bytes] = set()

    def look(self, steps: int, *, waits: bool) -> None:
        """Look around; `steps` states are published, and time `waits` for the next answer."""
        ends = living_publishers(self._node, names.ECU)
        commanders = {bytes(end.endpoint_gid) for end in ends}
        stands_still = steps == self._steps
        if not steps:
            topic = self._node.resolve_topic_name(names.ECU)
            self._warn(f'waiting for a controller that publishes {topic}')
        elif waits and stands_still:
            self._warn(f'waiting for the command that answers state {steps - 1}')
            if commanders - self._asked:  # who has come since may not have heard it
                self._outlet.repeat()
        else:
            self._asked = self._commanders
        self._commanders = commanders
        if steps and stands_still:
            self._outlet.tell_time()  # for who has come meanwhile
        self._steps = steps
        for sentence in incompatible_peers(self._node):
            self._warn(sentence)

    def _warn(self, sentence: str) -> None:
        if sentence not in self._warned:
            self._warned.add(sentence)
            self._node.get_logger().warning(sentence)
