"""rclpy's documented names over queues in one thread: for machines without ROS, and to judge code.

`install()` lets `import rclpy` and the imports of messages find what is here.
"""

from __future__ import annotations

import sys
from importlib import import_module
from importlib.machinery import ModuleSpec
from types import ModuleType
from typing import Any

from barc_sim.errors import UserError
from barc_sim.ros.local.executor import World, current, world
from barc_sim.ros.local.messages import LACKS, message_type, packages

__all__ = ['World', 'find_module', 'install', 'world']

#: rclpy's modules with their names; before each `:` stands the module of this package.
_NAMES = {
    'rclpy': """context: Context SignalHandlerOptions get_default_context init ok shutdown
        try_shutdown executor: Future parameters: Parameter
        node: create_node spin spin_once spin_until_future_complete""",
    'rclpy.callback_groups': """executor: CallbackGroup MutuallyExclusiveCallbackGroup
        ReentrantCallbackGroup""",
    'rclpy.client': 'node: Client',
    'rclpy.clock': 'executor: Clock ClockType',
    'rclpy.context': 'context: Context',
    'rclpy.duration': 'executor: Duration',
    'rclpy.exceptions': """context: NotInitializedException node: InvalidTopicNameException
        parameters: InvalidParameterTypeException InvalidParameterValueException
        ParameterAlreadyDeclaredException ParameterException ParameterNotDeclaredException""",
    'rclpy.executors': """executor: Executor ExternalShutdownException MultiThreadedExecutor
        SingleThreadedExecutor""",
    'rclpy.logging': 'context: LoggingSeverity get_logger',
    'rclpy.node': 'node: Node',
    'rclpy.parameter': 'parameters: Parameter parameter_value_to_python',
    'rclpy.publisher': 'node: Publisher',
    'rclpy.qos': """context: DurabilityPolicy HistoryPolicy QoSProfile ReliabilityPolicy
        qos_profile_sensor_data qos_profile_system_default""",
    'rclpy.signals': 'context: SignalHandlerOptions',
    'rclpy.subscription': 'node: Subscription',
    'rclpy.task': 'executor: Future',
    'rclpy.time': 'executor: Time',
}


class _StandIn(ModuleType):
    """A module of ROS; what it lacks is named in a sentence."""

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


_made: dict[str, ModuleType] = {}


def _modules() -> dict[str, ModuleType]:
    """Return the stand-ins by name."""
    if not _made:
        kinds = packages()
        for name in [*_NAMES, *(kind.partition('.')[0] for kind in kinds), *kinds]:
            module = _made.setdefault(name, _StandIn(name))
            module.__path__ = []
            parent, _, child = name.rpartition('.')
            if parent:
                setattr(_made[parent], child, module)
            source: Any = None
            for word in _NAMES.get(name, '').split():
                if word.endswith(':'):
                    source = import_module(f'{__name__}.{word[:-1]}')
                else:
                    setattr(module, word, getattr(source, word))
    return _made


def find_module(name: str) -> ModuleType | None:
    """Return the stand-in for a module of ROS, or None where `name` is none.

    Raises
    ------
    ImportError
        It is a module of rclpy that has no stand-in.
    """
    if name not in _modules() and name.startswith('rclpy.'):
        raise ImportError(f'{name} {LACKS}', name=name)
    return _modules().get(name)


class _Finder:
    """Finds the stand-ins, as a finder on `sys.meta_path` does."""

    def find_spec(self, name: str, *_: object) -> ModuleSpec | None:
        return ModuleSpec(name, self, is_package=True) if find_module(name) else None  # type: ignore[arg-type]

    def create_module(self, spec: ModuleSpec) -> ModuleType | None:
        return find_module(spec.name)

    def exec_module(self, module: ModuleType) -> None:
        """Do nothing: a stand-in is complete."""


_FINDER = _Finder()


def install() -> World:
    """Let `import rclpy` find the stand-ins; return the world of their nodes.

    Raises
    ------
    UserError
        This process has imported ROS's own rclpy.
    """
    there = sys.modules.get('rclpy')
    if there is not None and not isinstance(there, _StandIn):
        raise UserError(
            f'rclpy is imported already, from {there.__file__!r}: messages without ROS need a '
            'process of their own'
        )
    if _modules() and _FINDER not in sys.meta_path:
        sys.meta_path.insert(0, _FINDER)
    return current()
