"""The live page of a run without ROS."""

from __future__ import annotations

import time
from collections import deque
from functools import partial
from math import nan
from typing import TYPE_CHECKING, Any

from barc_sim.control.driver import DriverInput
from barc_sim.page.feed import FIELDS, STATE_FIELDS, Feed, controller_values, is_valid
from barc_sim.page.protocol import SIMULATOR
from barc_sim.simulation.log import CONTROLLER_STATE, PID_STATE, STATE

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence

    from barc_sim.page.feed import Sample
    from barc_sim.page.protocol import Drive
    from barc_sim.page.run_page import OnDone, RunPage
    from barc_sim.runs.local.host import LocalHost
    from barc_sim.runs.local.nodes import LocalController, LocalSimulator


class LocalFeed(Feed):
    """The states of a run with their other messages, from its publishers."""

    def __init__(self, host: LocalHost) -> None:
        """Take what the publishers of `host` publish from now on."""
        super().__init__()
        self._queue: deque[tuple[str, int, Sample]] = deque()
        for publisher in host.topics.publishers:
            topic = publisher.name.lstrip('/')
            if topic in (STATE, CONTROLLER_STATE) or topic in FIELDS:
                publisher.subscribe(partial(self._take, topic))
        self._new_states: list[tuple[int, Sample]] = []

    def _take(self, topic: str, stamp: int, fields: Mapping[str, Any]) -> None:
        if topic in (PID_STATE, CONTROLLER_STATE):
            terms = dict(zip(fields.get('names', ()), fields.get('values', ()), strict=True))
            values = controller_values(lambda name: terms.get(name, fields.get(name, nan)))
            topic = PID_STATE
        else:
            names = STATE_FIELDS if topic == STATE else FIELDS[topic]
            values = tuple(fields[name] for name in names)
        self._queue.append((topic, time.time_ns(), (stamp, values)))

    def _others(self) -> dict[str, list[Sample]]:
        others: dict[str, list[Sample]] = {topic: [] for topic in FIELDS}
        while self._queue:
            topic, received, sample = self._queue.popleft()
            if topic == STATE:
                self._new_states.append((received, sample))
            elif topic == PID_STATE or is_valid(sample[1]):
                others[topic].append(sample)
        return others

    def _states(self) -> list[tuple[int, Sample]]:
        states, self._new_states = self._new_states, []
        return states


class LocalClients:
    """Passes a page's requests to the loop, and the results back to the server's thread."""

    def __init__(
        self,
        host: LocalHost,
        simulator: LocalSimulator,
        controller: LocalController | None,
        deliver: Callable[[Callable[[], object]], None],
    ) -> None:
        """Serve the page of `simulator` and, if there is one, `controller`."""
        self._host, self._deliver = host, deliver
        self._simulator, self._controller = simulator, controller

    def reset(self, on_done: OnDone) -> None:
        """Reset the car to the start."""
        self._do(self._simulator.reset, on_done)

    def reset_controller(self, on_done: OnDone) -> None:
        """Reset the controller alone."""
        if self._controller:
            self._do(self._controller.reset, on_done)
        else:
            self._deliver(partial(on_done, False, 'the run has no controller'))

    def pause(self, on: bool, on_done: OnDone) -> None:
        """Pause or resume simulated time."""
        self._do(partial(self._simulator.pause, on=on), on_done)

    def tune(self, node: str, name: str, value: float, on_done: OnDone) -> None:
        """Set a parameter of a node."""
        of = self._simulator if node == SIMULATOR else self._controller

        def tune() -> None:
            why = of.tune(name, value) if of else 'the run has no controller'
            self._deliver(partial(on_done, not why, why))

        self._host.loop.call(tune)

    def _do(self, action: Callable[[], object], on_done: OnDone) -> None:
        def do() -> None:
            action()
            self._deliver(partial(on_done, True, ''))

        self._host.loop.call(do)

    def parameters(
        self, node: str, names: Sequence[str], on_values: Callable[[dict[str, Any]], None]
    ) -> bool:
        """Request parameters of a node; False if it is not there."""
        for each in self._host.nodes:
            if each.name == node:
                values = {name: each.parameters[name] for name in names if name in each.parameters}
                self._deliver(partial(on_values, values))
                return True
        return False


def serve(
    page: RunPage,
    host: LocalHost,
    clients: LocalClients,
    drive: Callable[[DriverInput], None],
) -> None:
    """Serve `page`; what a driver does in it is passed to `drive`, in the loop's thread."""

    def pass_on(command: Drive) -> None:
        request = DriverInput(command.linear, command.angular, command.brake)
        host.loop.call(partial(drive, request))

    def changes() -> Iterator[tuple[str, str, float]]:
        while host.changes:
            yield host.changes.popleft()

    page.start(LocalFeed(host), clients, pass_on, changes)
