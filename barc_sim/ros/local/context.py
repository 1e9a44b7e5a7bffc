"""What a program of ROS begins with: its context, the arguments after --ros-args, QoS, the log."""

from __future__ import annotations

import os
import sys
from contextlib import suppress
from dataclasses import dataclass
from enum import IntEnum
from fnmatch import fnmatchcase
from functools import partialmethod
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from barc_sim.cli.files import read_regular
from barc_sim.ros.local.executor import SECOND, World, current
from barc_sim.ros.local.messages import message_type

if TYPE_CHECKING:
    from collections.abc import Iterator

_PARAMETER, _REMAPPING = ('-p', '--param'), ('-r', '--remap')


class NotInitializedException(Exception):
    pass


class _Rule(NamedTuple):
    """A remapping, or a parameter, of the nodes that `node` matches; of all where it is empty."""

    node: str
    name: str
    value: Any


class Arguments:
    """The remappings and parameters of `--ros-args`; the log level is the world's."""

    def __init__(self, words: list[str], world: World) -> None:
        self._remappings: list[_Rule] = []
        self._parameters: list[_Rule] = []
        rest = iter(words)
        for word in rest:
            if word == '--ros-args':
                for option in iter(lambda: next(rest, '--'), '--'):
                    if option != '--ros-args':
                        self._add(option, next(rest, ''), world)

    def _add(self, option: str, text: str, world: World) -> None:
        target, assigned, value = text.partition(':=')
        node, _, name = target.rpartition(':')
        if option == '--log-level':
            level = (value if assigned else text).upper()
            if level not in LoggingSeverity.__members__:
                raise RuntimeError(f"Couldn't parse log level rule: '--log-level {text}'")
            world.log_levels[target if assigned else ''] = LoggingSeverity[level]
        elif option == '--params-file':
            self._parameters += _of_file(Path(text))
        elif option not in _PARAMETER + _REMAPPING:
            raise RuntimeError(f'found unknown ROS arguments: {option!r}')
        elif not (assigned and target):
            kind = 'param' if option in _PARAMETER else 'remap'
            raise RuntimeError(f"Couldn't parse {kind} rule: {text!r}: expected NAME:=VALUE")
        elif option in _PARAMETER:
            self._parameters.append(_Rule(node, name, _value(value)))
        else:
            self._remappings.append(_Rule(node, name, value))

    def remap(self, node: str, *names: str) -> str | None:
        """Return the new name by the node's first rule for one of `names`, if there is one."""
        for rule in self._remappings:
            if rule.node in ('', node) and rule.name in names:
                return str(rule.value)
        return None

    def of(self, node: str) -> dict[str, Any]:
        """Return the parameters for the node of this full name; the last one given counts."""
        return {
            rule.name: rule.value
            for rule in self._parameters
            if fnmatchcase(node, f'/{rule.node.lstrip("/")}' if rule.node else '*')
        }


# A submission's process has no PyYAML, and no arguments either.
def _value(text: str) -> Any:
    import yaml

    for kind in (int, float):
        with suppress(ValueError):
            return kind(text)
    return yaml.safe_load(text)


def _of_file(file: Path) -> Iterator[_Rule]:
    from barc_sim.bags.bounds import MAX_LONG_TEXT, from_yaml

    try:
        text = read_regular(file, MAX_LONG_TEXT).decode()
        for path, value in _flat(from_yaml(text), ''):
            node, _, name = path.partition('/ros__parameters/')
            yield _Rule(node, name.replace('/', '.'), value)
    except (OSError, ValueError, AttributeError) as error:
        raise RuntimeError(f'Error parsing the parameters in {str(file)!r}: {error}') from None


def _flat(tree: dict[str, Any], prefix: str) -> Iterator[tuple[str, Any]]:
    for name, value in tree.items():
        path = f'{prefix}/{name}' if prefix else name
        if isinstance(value, dict):
            yield from _flat(value, path)
        else:
            yield path, value


class Context:
    """What `init` begins and `shutdown` ends."""

    def __init__(self) -> None:
        self.world = current()
        self.is_ok = self.has_begun = False

    def init(self, args: list[str] | None = None) -> None:
        if self.has_begun:
            raise RuntimeError('Context.init() must only be called once')
        words = [] if self.world.simulated else sys.argv
        self.arguments = Arguments(words if args is None else args, self.world)
        if not (os.environ.get('ROS_DOMAIN_ID') or '0').isdecimal():
            raise RuntimeError('ROS_DOMAIN_ID is not an integral number')
        self.is_ok = self.has_begun = True

    def all(self, kind: str, name: str) -> list[Any]:
        """Return what nodes have of a kind, as `publishers`, under this full name."""
        every = (each for node in self.world.nodes for each in getattr(node, kind))
        return [each for each in every if each.topic_name == name]

    def ok(self) -> bool:
        return self.is_ok

    def shutdown(self) -> None:
        if not self.is_ok:
            raise RuntimeError('failed to shutdown: the context is not initialized')
        self.try_shutdown()

    def try_shutdown(self) -> None:
        self.is_ok = False

    def get_domain_id(self) -> int:
        return int(os.environ.get('ROS_DOMAIN_ID') or 0)


def get_default_context() -> Context:
    world = current()
    world.default_context = world.default_context or Context()
    return world.default_context  # type: ignore[no-any-return]


SignalHandlerOptions = IntEnum('SignalHandlerOptions', 'NO SIGINT SIGTERM ALL', start=0)


def init(*, args: list[str] | None = None, context: Context | None = None, **_: Any) -> None:
    """Begin; Ctrl-C is a KeyboardInterrupt with any options."""
    default = get_default_context()
    if context is None and default.has_begun and not default.is_ok:
        default = default.world.default_context = Context()
    (context or default).init(args)


def shutdown(*, context: Context | None = None, **_: Any) -> None:
    (context or get_default_context()).shutdown()


def try_shutdown(*, context: Context | None = None, **_: Any) -> None:
    (context or get_default_context()).try_shutdown()


def ok(*, context: Context | None = None) -> bool:
    context = context or get_default_context()
    if context.world.simulated:
        context.world.sleep(SECOND // 1000)  # a loop that asks comes to its end
    return context.is_ok


HistoryPolicy = IntEnum('HistoryPolicy', 'SYSTEM_DEFAULT KEEP_LAST KEEP_ALL UNKNOWN', start=0)
ReliabilityPolicy = IntEnum(
    'ReliabilityPolicy', 'SYSTEM_DEFAULT RELIABLE BEST_EFFORT UNKNOWN BEST_AVAILABLE', start=0
)
DurabilityPolicy = IntEnum(
    'DurabilityPolicy', 'SYSTEM_DEFAULT TRANSIENT_LOCAL VOLATILE UNKNOWN BEST_AVAILABLE', start=0
)


@dataclass(kw_only=True)
class QoSProfile:
    """What a publisher offers or a subscription requests; what counts here is what there is."""

    depth: int = 0
    history: Any = HistoryPolicy.KEEP_LAST
    reliability: Any = ReliabilityPolicy.RELIABLE
    durability: Any = DurabilityPolicy.VOLATILE

    @property
    def length(self) -> int | None:
        """How many messages a queue holds; None: all."""
        return None if self.history == HistoryPolicy.KEEP_ALL else max(self.depth, 1)

    def refuses(self, offered: QoSProfile) -> str:
        """Return the policy by which a subscription gets nothing of a publisher, or ''."""
        best_effort = offered.reliability == ReliabilityPolicy.BEST_EFFORT
        if best_effort and self.reliability == ReliabilityPolicy.RELIABLE:
            return 'RELIABILITY'
        latched = DurabilityPolicy.TRANSIENT_LOCAL
        return 'DURABILITY' if self.durability == latched != offered.durability else ''


qos_profile_system_default = QoSProfile(depth=10)
qos_profile_parameter_events = QoSProfile(depth=1000)
qos_profile_sensor_data = QoSProfile(depth=5, reliability=ReliabilityPolicy.BEST_EFFORT)
QOS_ROSOUT = QoSProfile(depth=1000, durability=DurabilityPolicy.TRANSIENT_LOCAL)


LoggingSeverity = IntEnum(
    'LoggingSeverity', {'UNSET': 0, 'DEBUG': 10, 'INFO': 20, 'WARN': 30, 'ERROR': 40, 'FATAL': 50}
)


class Logger:
    """Writes to stderr and, for a node, to `/rosout`."""

    def __init__(self, name: str, world: World, rosout: Any = None) -> None:
        self.name, self._world, self.rosout = name, world, rosout
        self._last: dict[tuple[Any, int], float] = {}  # [s] of each place that logs

    def get_child(self, name: str) -> Logger:
        return Logger(f'{self.name}.{name}', self._world, self.rosout)

    def set_level(self, level: int) -> None:
        self._world.log_levels[self.name] = level

    def get_effective_level(self) -> LoggingSeverity:
        name, levels = self.name, self._world.log_levels
        while name and not levels.get(name):
            name = name.rpartition('.')[0]
        return LoggingSeverity(levels.get(name) or LoggingSeverity.INFO)

    def _log(
        self,
        severity: LoggingSeverity,
        message: str,
        *,
        throttle_duration_sec: float = 0.0,
        skip_first: bool = False,
        once: bool = False,
    ) -> bool:
        if self._world.is_silent or severity < self.get_effective_level():
            return False
        frame = sys._getframe(1)  # noqa: SLF001 (who logs)
        place, now = (frame.f_code, frame.f_lineno), self._world.now() / SECOND
        last = self._last.get(place)
        if last is None:
            self._last[place] = now
        if skip_first if last is None else once or now < last + throttle_duration_sec:
            return False
        self._last[place] = now
        sec, nanosec = divmod(self._world.date(), SECOND)
        text = os.environ.get('RCUTILS_CONSOLE_OUTPUT_FORMAT')
        text = text or '[{severity}] [{time}] [{name}]: {message}'
        values = {'severity': severity.name, 'time': f'{sec}.{nanosec:09d}', 'name': self.name}
        for key, value in (values | {'message': message}).items():
            text = text.replace(f'{{{key}}}', value)
        print(text, file=sys.stderr, flush=True)  # noqa: T201
        if self.rosout:
            stamp = message_type('builtin_interfaces/msg/Time')(sec=sec, nanosec=nanosec)
            self.rosout.publish(
                message_type('rcl_interfaces/msg/Log')(
                    stamp=stamp,
                    level=int(severity),
                    name=self.name,
                    msg=message,
                    file=frame.f_code.co_filename,
                    function=frame.f_code.co_name,
                    line=frame.f_lineno,
                )
            )
        return True

    debug = partialmethod(_log, LoggingSeverity.DEBUG)
    info = partialmethod(_log, LoggingSeverity.INFO)
    warning = warn = partialmethod(_log, LoggingSeverity.WARN)
    error = partialmethod(_log, LoggingSeverity.ERROR)
    fatal = partialmethod(_log, LoggingSeverity.FATAL)


def get_logger(name: str) -> Logger:
    return Logger(name, current())
