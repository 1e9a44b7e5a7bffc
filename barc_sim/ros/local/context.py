"""What a program of ROS begins with: its context, the arguments after --ros-args, QoS, the log."""

from __future__ import annotations

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
        target, _, value = text.rpartition(':=')
        node, _, name = target.rpartition(':')
        if option == '--log-level':
            if value.upper() not in LoggingSeverity.__members__:
                raise RuntimeError(f"Couldn't parse log level rule: '--log-level {text}'")
            world.log_levels[target] = LoggingSeverity[value.upper()]
        elif option == '--params-file':
            self._parameters += _of_file(Path(text))
        elif option not in ('-p', '--param', '-r', '--remap'):
            raise RuntimeError(f'found unknown ROS arguments: {option!r}')
        elif not target:
            kind = 'param' if 'p' in option[:3] else 'remap'
            raise RuntimeError(f"Couldn't parse {kind} rule: {text!r}: expected NAME:=VALUE")
        elif option in ('-p', '--param'):
            self._parameters.append(_Rule(node, name, _value(value)))
        else:
            self._remappings.append(_Rule(node, name, value))

    def remap(self, node: str, *names: str) -> str | None:
        """Return the new name by the node's first rule for one of `names`, if there is one."""
        rules = (rule for rule in self._remappings if rule.node in ('', node))
        return next((rule.value for rule in rules if rule.name in names), None)

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


SignalHandlerOptions = IntEnum('SignalHandlerOptions', 'NO SIGINT SIGTERM ALL', start=0)


def init(*, args: list[str] | None = None, signal_handler_options: Any = None) -> None:
    """Begin; Ctrl-C is a KeyboardInterrupt with any options."""
    del signal_handler_options
    world = current()
    if world.is_ok:
        raise RuntimeError('Context.init() must only be called once')
    words = [] if world.simulated else sys.argv
    world.arguments = Arguments(words if args is None else args, world)
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
        world.sleep(SECOND // 1000)  # a loop that asks comes to its end
    return world.is_ok


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
        once: bool = False,
    ) -> bool:
        if self._world.is_silent or severity < self.get_effective_level():
            return False
        frame = sys._getframe(1)  # noqa: SLF001 (who logs)
        place, now = (frame.f_code, frame.f_lineno), self._world.now() / SECOND
        last = self._last.get(place)
        if last is not None and (once or now < last + throttle_duration_sec):
            return False
        self._last[place] = now
        sec, nanosec = divmod(self._world.date(), SECOND)
        time = f'{sec}.{nanosec:09d}'
        print(f'[{severity.name}] [{time}] [{self.name}]: {message}', file=sys.stderr, flush=True)  # noqa: T201
        if self.rosout:
            log = message_type('rcl_interfaces/msg/Log')(
                level=severity, name=self.name, msg=message
            )
            log.stamp.sec, log.stamp.nanosec = sec, nanosec
            log.file, log.function = frame.f_code.co_filename, frame.f_code.co_name
            log.line = frame.f_lineno
            self.rosout.publish(log)
        return True

    debug = partialmethod(_log, LoggingSeverity.DEBUG)
    info = partialmethod(_log, LoggingSeverity.INFO)
    warning = warn = partialmethod(_log, LoggingSeverity.WARN)
    error = partialmethod(_log, LoggingSeverity.ERROR)
    fatal = partialmethod(_log, LoggingSeverity.FATAL)


def get_logger(name: str) -> Logger:
    return Logger(name, current())
