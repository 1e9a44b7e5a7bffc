"""The entities that an executor executes, with what it notes of each."""

from __future__ import annotations

from dataclasses import dataclass, field
from traceback import walk_tb
from typing import TYPE_CHECKING, Any

from rclpy.callback_groups import MutuallyExclusiveCallbackGroup

from barc_sim.ros.executor.rclpy_private import ExclusiveClaim

if TYPE_CHECKING:
    from collections.abc import Callable

    from rclpy.callback_groups import CallbackGroup
    from rclpy.executors import MultiThreadedExecutor
    from rclpy.node import Node

    #: A function to call, and its arguments.
    Call = tuple[Callable[..., Any], tuple[Any, ...]]
    Take = Callable[['Entry', MultiThreadedExecutor], 'Call | None']

#: The names of a node's lists of entities, in the order in which rclpy executes ready entities.
KINDS = ('waitables', 'timers', 'subscriptions', 'guards', 'clients', 'services')
_OUR_MODULES = ('rclpy.', 'barc_sim.ros.executor.')


@dataclass(frozen=True)
class GroupClaim:
    """An entity's claim to a callback group of any type."""

    group: CallbackGroup
    entity: Any

    def begin(self) -> bool:
        """Claim the group; return False if it is busy."""
        if not self.group.can_execute(self.entity):
            return False
        return bool(self.group.beginning_execution(self.entity))

    def end(self) -> None:
        """Release the group."""
        self.group.ending_execution(self.entity)


@dataclass(eq=False, slots=True)
class Entry:
    """An entity of a node, and the number of arrivals for it that wait to be taken."""

    entity: Any  #: a timer, subscription, …: rclpy's have no type in common
    kind: str  #: of KINDS
    node: Node
    handle: Any
    claim: ExclusiveClaim | GroupClaim  #: to its callback group
    take: Take  #: returns the call that is due, or None for nothing
    pending: int = 0  #: arrivals that wait to be taken; there may be fewer messages
    reported: dict[str, int] = field(default_factory=dict)  #: the counts of the last QoS event
    is_slow: bool = False  #: whether its last callback took longer than `LASTING`
    descriptor: int = -1  #: the eventfd in which arrivals are counted
    in_memory: Any = None  #: the counter in memory that replaces it while no thread waits
    idle_uses: int = 0  #: uses until it gets a descriptor of its own; 0: it has one
    on_taken: Callable[[Entry], None] | None = None
    jump_handle: Any = None  #: of a timer: schedules it again when its clock jumps
    waited: Any = None  #: its stand-in in a wait set
    take_message: Any = None  #: a subscription's faster take

    def is_rclpys_error(self, error: BaseException, *, while_taking: bool = False) -> bool:
        """Return whether an error comes from rclpy's own code.

        A take or rclpy's own callback raises such an error, without other code in between.
        """
        if not isinstance(error, Exception):
            return False
        callback = getattr(self.entity, 'callback', None)
        module = str(getattr(callback, '__module__', None))
        if not (while_taking or module.startswith(_OUR_MODULES)):
            return False
        scopes = [frame.f_globals for frame, _ in walk_tb(error.__traceback__)]
        return all(str(scope.get('__name__')).startswith(_OUR_MODULES) for scope in scopes)

    def warn_of(self, error: BaseException) -> None:
        """Warn, at most once a second, that the data of an error of rclpy's is dropped."""
        name = getattr(self.entity, 'topic', type(self.entity).__name__)
        self.node.get_logger().warning(
            f'dropped data for {name!r} that rclpy cannot handle: {type(error).__name__}: {error}',
            throttle_duration_sec=1.0,
        )


def claim_of(entity: Any) -> ExclusiveClaim | GroupClaim:  # noqa: ANN401 (see `Entry`)
    """Return the claim of an entity to its callback group."""
    group = entity.callback_group
    if type(group) is MutuallyExclusiveCallbackGroup:  # a subclass may decide otherwise
        return ExclusiveClaim(group, entity)
    return GroupClaim(group, entity)
