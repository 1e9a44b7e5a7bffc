"""Waits for the nodes that command a simulator and resets them; warns when one is missing."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

from std_srvs.srv import Trigger

from barc_sim.interfaces import services, topics
from barc_sim.ros.peers import all_own, check_unique, full_names, publishers

if TYPE_CHECKING:
    from collections.abc import Callable

    from rclpy.client import Client
    from rclpy.clock import Clock
    from rclpy.node import Node
    from rclpy.task import Future
    from rclpy.topic_endpoint_info import TopicEndpointInfo

    from barc_sim.simulation.stepper import Stepper

_POLL_PERIOD = 0.01  #: [s]
#: Polls in a row that must find a controller before the first state. Nodes of one process discover
#: one another at once.
_POLLS = 3
#: The same for a controller in another process: it may discover this node a little later than this
#: node discovers it, and would miss messages. Our recorder discovers topics every 0.2 s.
_POLLS_OTHER_PROCESS = 40
_RESETS = (services.RESET_CONTROLLER, services.RESET_RELAY)
_RESET_TIMEOUT = 0.5  #: [s] to wait for the answers to the resets


class StartGate:
    """Delays the first state until a controller publishes `ecu` and has been reset.

    The reset is needed because the controller may have driven another run. A second publisher of
    the states is an error.
    """

    def __init__(self, node: Node, clock: Clock, begin: Callable[[], None], *, wait: bool) -> None:
        """Poll the graph of `node` by the wall `clock`; call `begin` when the run can start.

        `begin` publishes the first state. If `wait` is false, no controller is needed.
        """
        self._node = node
        self._begin = begin
        self._wait = wait

        self._clients: dict[str, Client] = {}
        self._uncalled: list[Client] = []  # to be called once they have discovered their servers
        self._answers: list[Future] = []
        self._give_up_at = 0.0
        self._is_reset = False

        self._polls_passed = 0
        self._polls_required = _POLLS
        self._timer = node.create_timer(_POLL_PERIOD, self._poll, clock=clock)

    def restart(self) -> None:
        """Reset the nodes that command, and call `begin` again after that."""
        self._uncalled = self._resets()
        self._answers = []
        self._give_up_at = time.monotonic() + _RESET_TIMEOUT
        # One more poll is enough for a controller that was discovered before.
        self._polls_passed = min(self._polls_passed, self._polls_required - 1)
        self._is_reset = True
        self._timer.reset()

    def _resets(self) -> list[Client]:
        """Return a client for each reset service that has a server.

        A client without a server would make ROS list the service.
        """
        served = [name for name in _RESETS if self._node.count_services(name)]
        for name in served:
            if name not in self._clients:
                self._clients[name] = self._node.create_client(Trigger, name)
        return [self._clients[name] for name in served]

    def _poll(self) -> None:
        self._call_resets()
        if self._waits_for_answers():
            return
        self._count_poll()
        if self._polls_passed < self._polls_required:
            return

        if not self._is_reset:
            self.restart()
            return
        self._timer.cancel()
        check_unique(self._node, topics.STATE)
        self._begin()

    def _call_resets(self) -> None:
        """Call the reset services that have been discovered since the last poll."""
        for client in [*self._uncalled]:
            if client.service_is_ready():
                self._uncalled.remove(client)
                self._answers.append(client.call_async(Trigger.Request()))

    def _waits_for_answers(self) -> bool:
        """Return whether a reset is not answered; after a while, warn and wait no longer."""
        if not self._uncalled and all(answer.done() for answer in self._answers):
            return False
        if time.monotonic() < self._give_up_at:
            return True

        self._node.get_logger().warning(
            f'a controller or relay has not answered its reset within {_RESET_TIMEOUT} s'
        )
        self._uncalled = []
        self._answers = []
        return False

    def _count_poll(self) -> None:
        """Count a poll that has found a controller; start again if there is none."""
        commanders = publishers(self._node, topics.ECU)
        self._polls_required = _POLLS if all_own(self._node, commanders) else _POLLS_OTHER_PROCESS
        if commanders or not self._wait:
            self._polls_passed += 1
        else:
            self._polls_passed = 0
        self._resets()  # the clients can discover their servers during the next polls


class PeerWatch:
    """Warns, once for each cause, when no node or more than one commands, or publishes `/clock`.

    While time waits for the answer to a state, the state is published again for a controller that
    has started since. A killed node still counts as a publisher for 20 s, until DDS notices.
    """

    def __init__(
        self,
        node: Node,
        stepper: Stepper,
        republish: Callable[[], None],
        publish_clock: Callable[[], None],
    ) -> None:
        """Watch the peers of `node`; both functions publish its latest state or time again."""
        self._node = node
        self._stepper = stepper
        self._republish = republish
        self._publish_clock = publish_clock

        self._states = 0
        self._warned: set[str] = set()
        # GIDs of the publishers of commands: all at the latest check, and those that were there
        # when the present state was published.
        self._commanders: set[bytes] = set()
        self._reached: set[bytes] = set()

    def check(self) -> None:
        """Check the peers, and whether a reset waits for an answer; call it about once a second."""
        self._stepper.check()
        states = self._stepper.states
        stands_still = states == self._states

        endpoints = publishers(self._node, topics.ECU)
        self._check_commanders(endpoints, stands_still=stands_still)
        self._warn_of_several(topics.ECU, endpoints, 'drive together: end one')

        clocks = publishers(self._node, topics.CLOCK)
        self._warn_of_several(topics.CLOCK, clocks, 'time jumps: give each run a ROS_DOMAIN_ID')
        if states and stands_still:
            self._publish_clock()  # for nodes that have started since
        self._states = states

    def _check_commanders(self, endpoints: list[TopicEndpointInfo], *, stands_still: bool) -> None:
        """Warn if no command comes; publish the state again for a new publisher of commands."""
        commanders = {bytes(each.endpoint_gid) for each in endpoints}
        states = self._stepper.states
        waits = self._stepper.deadline_period is None and not self._stepper.paused
        if not states:
            if not endpoints:
                topic = self._node.resolve_topic_name(topics.ECU)
                self._warn(f'waiting for a controller that publishes {topic}')
        elif waits and stands_still:
            self._warn(f'waiting for the command that answers state {states - 1}')
            if commanders - self._reached:
                self._republish()
        else:
            self._reached = self._commanders
        self._commanders = commanders

    def _warn_of_several(self, topic: str, endpoints: list[TopicEndpointInfo], effect: str) -> None:
        if len(endpoints) > 1:
            name = self._node.resolve_topic_name(topic)
            rivals = ' and '.join(full_names(endpoints))
            hint = '(a killed node still counts for 20 s)'
            self._warn(f'{rivals} publish {name} and {effect} {hint}')

    def _warn(self, sentence: str) -> None:
        if sentence not in self._warned:
            self._warned.add(sentence)
            self._node.get_logger().warning(sentence)
