"""A stand-in for rclpy: its documented API over queues in one thread.

It is for machines without ROS, and to judge students' code. After `install()`, `import rclpy` and
the imports of messages find it.
"""

from __future__ import annotations

import sys
from functools import cache
from importlib import import_module
from importlib.machinery import ModuleSpec
from types import ModuleType, SimpleNamespace
from typing import Any

from barc_sim.errors import UserError
from barc_sim.ros.local.messages import LACKS, message_type, packages
from barc_sim.ros.local.world import World, current, world

__all__ = ['World', 'find_module', 'install', 'world']

#: The modules here that define rclpy's names.
_SOURCES = ('clock', 'entities', 'executor', 'logger', 'node', 'parameters', 'program', 'qos')
#: rclpy's modules with their names, which the modules here define.
_NAMES = {
    'rclpy': """Future Parameter SignalHandlerOptions create_node init ok shutdown spin spin_once
        spin_until_future_complete try_shutdown""",
    'rclpy.callback_groups': 'CallbackGroup MutuallyExclusiveCallbackGroup ReentrantCallbackGroup',
    'rclpy.client': 'Client',
    'rclpy.clock': 'Clock ClockType',
    'rclpy.duration': 'Duration',
    'rclpy.exceptions': """InvalidParameterTypeException InvalidParameterValueException
        InvalidTopicNameException NotInitializedException ParameterAlreadyDeclaredException
        ParameterException ParameterNotDeclaredException""",
    'rclpy.executors': """Executor ExternalShutdownException MultiThreadedExecutor
        SingleThreadedExecutor""",
    'rclpy.logging': 'LoggingSeverity get_logger',
    'rclpy.node': 'Node',
    'rclpy.parameter': 'Parameter parameter_value_to_python',
    'rclpy.publisher': 'Publisher',
    'rclpy.qos': """DurabilityPolicy HistoryPolicy QoSProfile ReliabilityPolicy
        qos_profile_sensor_data qos_profile_system_default""",
    'rclpy.signals': 'SignalHandlerOptions',
    'rclpy.subscription': 'Subscription',
    'rclpy.task': 'Future',
    'rclpy.time': 'Time',
}


class _StandIn(ModuleType):
    """A stand-in for a module of ROS; a name that it lacks raises a sentence."""

    def __getattr__(self, name: str) -> Any:
        package, _, kind = self.__name__.partition('.')
        if name.startswith('__') or name in _modules():
            raise AttributeError(name)
        if package != 'rclpy' and kind:
            try:
                return message_type(f'{package}/{kind}/{name}')
            except LookupError:
                pass
        raise ImportError(f'{self.__name__}.{name} {LACKS}')


@cache
def _modules() -> dict[str, ModuleType]:
    """Return the stand-ins by name."""
    names: dict[str, Any] = {}
    for source in _SOURCES:
        names |= vars(import_module(f'{__name__}.{source}'))
    kinds = packages()
    modules: dict[str, ModuleType] = {}
    roots = [kind.partition('.')[0] for kind in kinds]
    for name in (*_NAMES, *roots, *kinds):
        module = modules.setdefault(name, _StandIn(name))
        module.__path__ = []
        module.__spec__ = ModuleSpec(name, None, is_package=True)
        vars(module).update({word: names[word] for word in _NAMES.get(name, '').split()})

        parent, _, child = name.rpartition('.')
        if parent:
            setattr(modules[parent], child, module)
    return modules


def find_module(name: str) -> ModuleType | None:
    """Return the stand-in for a module of ROS.

    Parameters
    ----------
    name
        The full name of the module, such as `std_msgs.msg`.

    Returns
    -------
    ModuleType or None
        The stand-in; None: it is no module of ROS.

    Raises
    ------
    ImportError
        It is a module of rclpy that has no stand-in.
    """
    if name not in _modules() and name.startswith('rclpy.'):
        raise ImportError(f'{name} {LACKS}', name=name)
    return _modules().get(name)


def _find_spec(name: str, *_: object) -> None:
    """Raise an ImportError for a module of rclpy that has no stand-in."""
    find_module(name)


#: A finder for `sys.meta_path`.
_FINDER: Any = SimpleNamespace(find_spec=_find_spec)


def install() -> World:
    """Make `import rclpy` find the stand-ins, in this process.

    Returns
    -------
    World
        The world of their nodes.

    Raises
    ------
    UserError
        This process has imported ROS's own rclpy.
    """
    imported = sys.modules.get('rclpy')
    if imported is not None and not isinstance(imported, _StandIn):
        raise UserError(
            f'rclpy is imported already, from {imported.__file__!r}: use another process for '
            'messages without ROS'
        )
    sys.modules.update(_modules())
    if _FINDER not in sys.meta_path:
        sys.meta_path.insert(0, _FINDER)
    return current()
