"""rclpy's functions for a program: to initialise, spin a node, and shut down."""

from __future__ import annotations

import sys
from contextlib import contextmanager
from enum import IntEnum
from typing import TYPE_CHECKING, Any

from barc_sim.ros.local.executor import Executor
from barc_sim.ros.local.node import Node
from barc_sim.ros.local.parameters import Arguments
from barc_sim.ros.local.world import SECOND, current

if TYPE_CHECKING:
    from collections.abc import Iterator

    from barc_sim.ros.local.executor import Future

SignalHandlerOptions = IntEnum('SignalHandlerOptions', 'NO SIGINT SIGTERM ALL', start=0)


def init(*, args: list[str] | None = None, signal_handler_options: Any = None) -> None:
    """Initialise rclpy.

    Parameters
    ----------
    args
        The words of the command line; by default those of the process, none in simulated time.
    signal_handler_options
        Without effect: Ctrl-C is a KeyboardInterrupt with any of them.

    Raises
    ------
    RuntimeError
        It is initialised already, or an argument cannot be parsed.
    """
    del signal_handler_options
    world = current()
    if world.is_ok:
        raise RuntimeError('Context.init() must only be called once')
    words = [] if world.simulated else sys.argv
    world.arguments = Arguments(words if args is None else args)
    world.log_levels |= world.arguments.log_levels
    world.is_ok = True


def shutdown() -> None:
    """Shut down rclpy, which ends every spin; RuntimeError: it is not initialised."""
    if not current().is_ok:
        raise RuntimeError('failed to shutdown: the context is not initialized')
    try_shutdown()


def try_shutdown() -> None:
    """Shut down rclpy if it is initialised."""
    current().is_ok = False


def ok() -> bool:
    """Return whether rclpy is initialised, and not shut down."""
    world = current()
    if world.simulated:
        world.sleep(SECOND // 1000)  # so that a loop `while rclpy.ok()` ends
    return world.is_ok


create_node = Node


@contextmanager
def _in_executor(node: Node, executor: Executor | None) -> Iterator[Executor]:
    """Give an executor that has the node during the block."""
    executor = executor or Executor()
    executor_before = node.executor
    executor.add_node(node)
    try:
        yield executor
    finally:
        if executor_before is not executor:
            executor.remove_node(node)


def spin(node: Node, executor: Executor | None = None) -> None:
    """Call the callbacks of a node until rclpy is shut down.

    Parameters
    ----------
    node
        The node.
    executor
        It calls them, and those of its other nodes; by default a new one.
    """
    with _in_executor(node, executor) as spinning:
        spinning.spin()


def spin_once(
    node: Node, *, executor: Executor | None = None, timeout_sec: float | None = None
) -> None:
    """Call one callback of a node, or of another node of the executor.

    Parameters
    ----------
    node, executor
        As of `spin`.
    timeout_sec
        The longest time [s] to wait for it; by default there is no limit.
    """
    with _in_executor(node, executor) as spinning:
        spinning.spin_once(timeout_sec)


def spin_until_future_complete(
    node: Node, future: Future, executor: Executor | None = None, timeout_sec: float | None = None
) -> None:
    """Call callbacks until a future has its result.

    Parameters
    ----------
    node, executor
        As of `spin`.
    future
        The future.
    timeout_sec
        The longest time [s]; by default there is no limit.
    """
    with _in_executor(node, executor) as spinning:
        spinning.spin_until_future_complete(future, timeout_sec)
