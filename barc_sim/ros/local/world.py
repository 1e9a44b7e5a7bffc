"""The world of a program: what its nodes share, and its time, real or simulated.

When no callback is left to call in simulated time, time jumps to the next timer: a minute takes
milliseconds, and every run has the same order.
"""

from __future__ import annotations

import time
from contextlib import contextmanager
from contextvars import ContextVar
from math import inf
from typing import TYPE_CHECKING, Any, Protocol

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterator

SECOND = 1_000_000_000  #: [ns]


class OuterExecutor(Protocol):
    """The executor of the nodes around a program, which runs while the program waits."""

    def add_node(self, node: Any) -> bool:
        """Add a node; return False if it is there already."""

    def next_due(self) -> float:
        """Return when the next callback is due [ns]; infinity: none is."""

    def run_once(self, until: float) -> bool:
        """Call one callback that is ready; otherwise wait for one, at most until `until` [ns]."""


class EndOfTimeError(BaseException):
    """Simulated time is over; not an Exception, so that user code does not catch it."""


class World:
    """What the nodes of a program share: the time, the graph, and rclpy's context.

    Parameters
    ----------
    simulated
        Whether time is simulated; otherwise it is that of the wall clock.

    Attributes
    ----------
    now
        Returns the time [ns] that paces timers.
    date
        Returns the time [ns] since the epoch, or since the start of simulated time.
    nodes
        All nodes.
    log_levels
        By the name of the logger.
    """

    end = inf  #: of simulated time [ns]
    flat_names: Collection[str] = ()  #: topics that ignore namespaces
    is_silent = False  #: whether nothing is logged
    is_ok = False  #: whether rclpy is initialised, and not shut down
    arguments: Any  #: of `--ros-args`

    def __init__(self, *, simulated: bool = False) -> None:
        self.simulated = simulated
        self.now_ns = 0
        self.now: Callable[[], int] = self._simulated_now if simulated else time.monotonic_ns
        self.date: Callable[[], int] = self.now if simulated else time.time_ns
        self.nodes: list[Any] = []
        self.log_levels: dict[str, int] = {}
        #: Runs while a program waits: the nodes around the program, such as the simulator.
        self.around: OuterExecutor | None = None

    def _simulated_now(self) -> int:
        return self.now_ns

    def ok(self) -> bool:
        """Return whether rclpy is initialised, and not shut down."""
        return self.is_ok

    def all(self, kind: str, name: str) -> list[Any]:
        """Return the entities of all nodes with a name.

        Parameters
        ----------
        kind
            The name of a node's list of entities, such as `publishers`.
        name
            The full name of their topic or service.

        Returns
        -------
        list
            The entities.
        """
        entities = (each for node in self.nodes for each in getattr(node, kind))
        return [each for each in entities if each.topic_name == name]

    def sleep(self, nanoseconds: int) -> None:
        """Wait for this time [ns]."""
        if not self.simulated:
            time.sleep(nanoseconds / SECOND)
            return
        until = self.now_ns + nanoseconds
        while self.now_ns < until:
            self.pass_time(until)

    def pass_time(self, until: float) -> None:
        """In simulated time, run the next callback of `around`, or jump to `until` [ns]."""
        due = self.around.next_due() if self.around else inf
        if due > until or not self.around:
            self._jump(until)
        elif due <= self.now_ns or self._jump(due):
            self.around.run_once(due)

    def _jump(self, to: float) -> bool:
        """Set the time to `to` [ns]; return False if simulated time ends before."""
        if min(to, self.end) == inf:
            raise RuntimeError('this wait has no end: simulated time has no more events')
        self.now_ns = int(min(max(to, self.now_ns), self.end))
        if to < self.end:
            return True
        self.at_end()
        return False

    def at_end(self) -> None:
        """End the program; a subclass can give it more time instead."""
        raise EndOfTimeError


_current: ContextVar[World] = ContextVar('world', default=World())  # noqa: B039 (of all)
#: Returns the world of the running program.
current = _current.get


@contextmanager
def world(other: World) -> Iterator[World]:
    """Run the block in another world, in this thread.

    Parameters
    ----------
    other
        The world.

    Yields
    ------
    World
        The same.
    """
    token = _current.set(other)
    try:
        yield other
    finally:
        _current.reset(token)
