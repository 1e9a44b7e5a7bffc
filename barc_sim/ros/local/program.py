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
    """Initialise rclpy; Ctrl-C is a KeyboardInterrupt with any options."""
    del signal_handler_options
    world = current()
    if world.is_ok:
        raise RuntimeError('Context.init() must only be called once')
    words = [] if world.simulated else sys.argv
    world.arguments = Arguments(words if args is None else args)
    world.log_levels |= world.arguments.log_levels
    world.is_ok = True


def shutdown() -> None:
    if not current().is_ok:
        raise RuntimeError('failed to shutdown: the context is not initialized')
    try_shutdown()


def try_shutdown() -> None:
    current().is_ok = False


def ok() -> bool:
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
    with _in_executor(node, executor) as spinning:
        spinning.spin()


def spin_once(
    node: Node, *, executor: Executor | None = None, timeout_sec: float | None = None
) -> None:
    with _in_executor(node, executor) as spinning:
        spinning.spin_once(timeout_sec)


def spin_until_future_complete(
    node: Node, future: Future, executor: Executor | None = None, timeout_sec: float | None = None
) -> None:
    with _in_executor(node, executor) as spinning:
        spinning.spin_until_future_complete(future, timeout_sec)
