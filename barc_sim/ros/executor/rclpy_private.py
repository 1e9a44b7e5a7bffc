"""The private names of rclpy that the executor takes, and whether this rclpy's are as they were."""

# ruff: noqa: SLF001 - rclpy's private names are the point.

from __future__ import annotations

from contextlib import suppress
from inspect import signature
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

from rclpy.executors import Executor, MultiThreadedExecutor
from rclpy.guard_condition import GuardCondition
from rclpy.impl.implementation_singleton import rclpy_implementation as _rclpy
from rclpy.waitable import Waitable

if TYPE_CHECKING:
    from collections.abc import Callable

#: Kinds of entities with a handle, in the order in which rclpy executes what is ready.
KINDS = ('timer', 'subscription', 'guard_condition', 'client', 'service')

_TAKES = tuple(f'_take_{kind}' for kind in (*KINDS, 'waitable'))

#: Methods, and attributes of instances.
_NAMES: tuple[tuple[Any, tuple[str, ...]], ...] = (
    (Executor, ('_guard', '_sigint_gc', '_is_shutdown', '_tasks', '_tasks_lock')),
    (Executor, ('_wait_for_ready_callbacks', *_TAKES)),
    (MultiThreadedExecutor, ('_spin_once_impl', '_executor')),
    (GuardCondition, ('_executor_event', '_executor_triggered')),
    (Waitable, ('_executor_event',)),
    (_rclpy.Timer, ('is_timer_ready', 'pointer')),
    (_rclpy.WaitSet, ('clear_entities', 'wait', 'get_ready_entities')),
    (_rclpy.WaitSet, tuple(f'add_{kind}' for kind in KINDS)),
)

#: How the methods are called, without `self`.
_CALLS: dict[str, tuple[Any, ...]] = {
    **dict.fromkeys(_TAKES, (None,)),
    '_wait_for_ready_callbacks': (None, None, bool),
    '_spin_once_impl': (None, bool),
}


def differing() -> list[str]:
    """Return the private names that this rclpy lacks, or that behave differently in it."""
    lacking = [
        f'{owner.__name__}.{name}'
        for owner, names in _NAMES
        for name in names
        if not hasattr(owner, name) and name not in owner.__init__.__code__.co_names
    ]
    return lacking or [
        f'MultiThreadedExecutor.{name} as in rclpy 7.1'
        for name, arguments in _CALLS.items()
        if not _can_be_called(getattr(MultiThreadedExecutor, name), arguments)
        or (name == '_take_guard_condition' and not _yields_what_to_await())
    ]


def _can_be_called(method: Callable[..., Any], arguments: tuple[Any, ...]) -> bool:
    try:
        signature(method).bind(None, *arguments)
    except TypeError:
        return False
    return True


def _yields_what_to_await() -> bool:
    """Return whether a take gives a function whose coroutine, awaited, calls the callback."""
    called: list[bool] = []
    guard = SimpleNamespace(_executor_triggered=True, callback=lambda: called.append(True))
    with suppress(Exception):
        coroutine = MultiThreadedExecutor._take_guard_condition(None, guard)()
        try:
            coroutine.send(None)
        except StopIteration:
            return called == [True] and not guard._executor_triggered
    return False
