"""Use the executor where rclpy lacks a name, or has another version; print the warnings.

`use_without.py` | `use_without.py name OWNER NAME` | `use_without.py version VERSION`
"""

from __future__ import annotations

import importlib.metadata
import sys
import warnings
from pkgutil import resolve_name

import rclpy.executors
from rclpy.node import Node

match sys.argv[1:]:
    case ['name', owner, name]:
        delattr(resolve_name(owner), name)
    case ['version', version]:
        importlib.metadata.version = lambda _: version

with warnings.catch_warnings(record=True) as caught:
    warnings.simplefilter('always')
    from barc_sim.ros.executor import QuickExecutor
for warning in caught:
    if 'QuickExecutor' in str(warning.message):
        print(warning.message)

rclpy.init()
node = Node('tested')
ticks: list[int] = []
node.create_timer(0.001, lambda: ticks.append(1))
with QuickExecutor(2) as executor:
    executor.add_node(node)
    while not ticks:
        executor.spin_once(timeout_sec=1.0)
    node.create_timer(0.001, lambda: 1 / 0)
    try:
        executor.spin()
    except ZeroDivisionError:
        print('works')
node.destroy_node()
rclpy.shutdown()
