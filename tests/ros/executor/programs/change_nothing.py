"""Use the executor; print whether rclpy's classes, the process and an entity are as before."""

from __future__ import annotations

import resource
import sys
from typing import Any

import builtin_interfaces.msg  # noqa: F401 (its classes, too, must not change)
import rclpy.action
import rclpy.executors
from rclpy.node import Node

Contents = dict[type, dict[str, Any]]


def rclpys_classes() -> Contents:
    """Return the contents of rclpy's classes."""
    modules = [m for m in list(sys.modules.values()) if m.__name__.startswith('rclpy')]
    classes = {c for m in modules for c in vars(m).values() if isinstance(c, type)}
    return {c: dict(vars(c)) for c in classes if c.__module__.startswith('rclpy')}


rclpy.init()
node = Node('tested')
node.create_timer(0.001, lambda: None)
entity = node.create_guard_condition(print)
handle = entity.handle
with rclpy.executors.MultiThreadedExecutor(2) as theirs:
    theirs.add_node(node)
    theirs.spin_once()

classes = rclpys_classes()
limit = resource.getrlimit(resource.RLIMIT_NOFILE)
from barc_sim.ros.executor import QuickExecutor

with QuickExecutor(2) as executor:
    executor.add_node(node)
    executor.spin_once()
now = rclpys_classes()
print(all(now[c] == contents for c, contents in classes.items()))
print(resource.getrlimit(resource.RLIMIT_NOFILE) == limit)
print(entity.handle is handle and 'destroy' not in vars(entity))
