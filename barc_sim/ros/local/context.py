"""What a program of ROS begins with: its context and arguments, names, QoS, and its log."""

from __future__ import annotations

import os
import re
import signal
import sys
import threading
from contextlib import suppress
from enum import IntEnum
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from barc_sim.ros.local.clocks import SECOND, Clock, Duration, World, current
from barc_sim.ros.local.messages import message_type

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator


# Exceptions, with rclpy's names and words.


class NotInitializedException(Exception):
    def __init__(self, message: str = '') -> None:
        super().__init__(
            'rclpy.init() has not been called' + (f'. msg:{message}' if message else '.')
        )


class InvalidHandle(Exception):
    pass


class ROSInterruptException(Exception):
    def __init__(self) -> None:
        super().__init__('rclpy.shutdown() has been called')


class NameValidationException(Exception):
    kind = 'name'

    def __init__(self, name: str, error_msg: str, invalid_index: int) -> None:
        pointer = ' ' * invalid_index + '^'
        super().__init__(f"Invalid {self.kind}: {error_msg}:\n  '{name}'\n   {pointer}")


class InvalidNodeNameException(NameValidationException):
    kind = 'node name'


class InvalidNamespaceException(NameValidationException):
    kind = 'namespace'


class InvalidTopicNameException(NameValidationException):
    kind = 'topic name'


class InvalidServiceNameException(NameValidationException):
    kind = 'service name'


def check_name(name: str, error: type[NameValidationException], others: str = '') -> None:
    """Refuse a name with characters that ROS does not allow; `others` are allowed besides."""
    if not name:
        raise error(name, 'must not be empty', 0)
    wrong = re.search(f'[^A-Za-z0-9_{others}]', name)
    if wrong:
        raise error(
            name,
            f'must not contain characters other than alphanumerics, {"_" + others!r}',
            wrong.start(),
        )
    wrong = re.search(r'(?:^|/)(?=\d)', name)
    if wrong:
        raise error(name, 'must not start with a number', wrong.end())
    wrong = re.search(r'//|.(?<=/)$', name) if len(name) > 1 else None
    if wrong:
        raise error(name, "must not end with '/' or contain '//'", wrong.start())


# Arguments: --ros-args.


class _Rule(NamedTuple):
    """A remapping or a parameter of the nodes that `node` matches."""

    node: str
    name: str
    value: Any


_TAKES = {
    '-r': 'remap',
    '--remap': 'remap',
    '-p': 'param',
    '--param': 'param',
    '--params-file': 'file',
    '--log-level': 'level',
}
_IGNORED = re.compile(r'--(?:enable|disable)-(?:rosout|stdout|external-lib)-logs|--log-config-file')


class Arguments:
    """The remappings and parameters of `--ros-args`; the log level is the world's."""

    def __init__(self, words: list[str], world: World) -> None:
        self.remaps: list[_Rule] = []
        self.parameters: list[_Rule] = []
        rest = iter(words)
        for word in rest:
            if word != '--ros-args':
                continue
            for option in rest:
                if option == '--':
                    break
                if option == '--ros-args' or _IGNORED.fullmatch(option):
                    continue
                value = next(rest, None)
                if option not in _TAKES or value is None:
                    raise RuntimeError(
                        f'found unknown ROS arguments, or one without its value: {option!r}'
                    )
                self._add(_TAKES[option], value, world)

    def _add(self, kind: str, text: str, world: World) -> None:
        target, assigned, value = text.partition(':=')
        if kind == 'level':
            name, level = (target, value) if assigned else ('', text)
            if level.upper() not in LoggingSeverity.__members__:
                raise RuntimeError(f"Couldn't parse log level rule: --log-level {text}")
            world.log_levels[name] = LoggingSeverity[level.upper()]
        elif kind == 'file':
            self.parameters += _of_file(Path(text))
        elif not (assigned and target):
            raise RuntimeError(f"Couldn't parse {kind} rule: {text!r}: expected NAME:=VALUE")
        elif kind == 'param':
            node, _, name = target.rpartition(':')
            self.parameters.append(_Rule(node or '/**', name, _value(value)))
        else:
            node, _, name = (
                target.partition(':') if not target.startswith('/') else ('', '', target)
            )
            if not name:
                node, name = '', target
            self.remaps.append(_Rule(node, name, value))

    def remap(self, node: str, names: dict[str, str]) -> str | None:
        """Return the new name by the first rule of the node for one of `names`, if there is one."""
        for rule in self.remaps:
            if rule.node in ('', node) and (rule.name in names or rule.name in names.values()):
                return str(rule.value)
        return None

    def of(self, node: str) -> dict[str, Any]:
        """Return the parameters for the node of this full name; the last one given counts."""
        return {
            rule.name: rule.value for rule in self.parameters if _pattern(rule.node).fullmatch(node)
        }


def _pattern(node: str) -> re.Pattern[str]:
    anywhere = re.escape(node if node.startswith('/') else f'/{node}').replace(r'/\*\*', '(/.*)?')
    return re.compile(anywhere.replace(r'\*', '[^/]*'))


def _value(text: str) -> Any:
    for kind in (int, float):
        with suppress(ValueError):
            return kind(text)
    import yaml

    return yaml.safe_load(text)


def _of_file(file: Path) -> Iterator[_Rule]:
    import yaml

    try:
        nodes = yaml.safe_load(file.read_text(encoding='utf-8'))
        for path, values in _flat(nodes, '/'):
            node, _, name = path.partition('/ros__parameters/')
            yield _Rule(node, name.replace('/', '.'), values)
    except (OSError, ValueError, AttributeError, yaml.YAMLError) as error:
        raise RuntimeError(f'Error parsing the file of parameters {str(file)!r}: {error}') from None


def _flat(tree: dict[str, Any], mark: str, prefix: str = '') -> Iterator[tuple[str, Any]]:
    for name, value in tree.items():
        path = f'{prefix}{mark}{name}' if prefix else str(name)
        if isinstance(value, dict):
            yield from _flat(value, mark, path)
        else:
            yield path, value


# Contexts.


class Context:
    """What `init` begins and `shutdown` ends; its nodes see those of the same domain."""

    def __init__(self) -> None:
        self.world = current()
        self.is_ok = self.begun = False
        self._callbacks: list[Callable[[], object]] = []
        self.executor: Any = None

    def init(self, args: list[str] | None = None, *, domain_id: int | None = None) -> None:
        if self.begun:
            raise RuntimeError('Context.init() must only be called once')
        words = [] if self.world.simulated else sys.argv
        self.arguments = Arguments(words if args is None else args, self.world)
        given = int(os.environ.get('ROS_DOMAIN_ID') or 0)
        self._domain = given if domain_id is None else domain_id
        self.is_ok = self.begun = True

    @property
    def graph(self) -> Any:
        """The nodes and topics of the domain."""
        return self.world.graphs.setdefault(self._domain, Graph())

    def ok(self) -> bool:
        return self.is_ok

    def shutdown(self) -> None:
        if not self.begun:
            raise RuntimeError('Context must be initialized before it can be shutdown')
        if not self.is_ok:
            raise RuntimeError('Context has been shut down already')
        self.try_shutdown()

    def try_shutdown(self) -> None:
        if self.is_ok:
            self.is_ok = False
            while self._callbacks:
                self._callbacks.pop(0)()

    def on_shutdown(self, callback: Callable[[], object]) -> None:
        if self.begun and not self.is_ok:
            callback()
        else:
            self._callbacks.append(callback)

    def get_domain_id(self) -> int:
        return self._domain

    def __enter__(self) -> Context:  # noqa: PYI034 (Self is newer than Python 3.10)
        self.init()
        return self

    def __exit__(self, *_: object) -> None:
        self.try_shutdown()


class Graph:
    """The nodes of a domain; each has its publishers, subscriptions, services and clients."""

    def __init__(self) -> None:
        self.nodes: list[Any] = []

    def all(self, kind: str, name: str) -> list[Any]:
        """Return the entities of a kind, as `publishers`, that have this full name."""
        return [
            each for node in self.nodes for each in getattr(node, kind) if each.full_name == name
        ]


def get_default_context(*, shutting_down: bool = False) -> Context:
    """Return the context that `rclpy.init` begins; after its end, a new one where asked for."""
    contexts = current().contexts
    if 'default' not in contexts or (shutting_down and contexts['default'].begun):
        contexts['default'] = Context()
    return contexts['default']  # type: ignore[no-any-return]


class SignalHandlerOptions(IntEnum):
    NO = 0
    SIGINT = 1
    SIGTERM = 2
    ALL = 3


def init(
    *,
    args: list[str] | None = None,
    context: Context | None = None,
    domain_id: int | None = None,
    signal_handler_options: SignalHandlerOptions | None = None,
) -> None:
    default = context is None
    if context is None:
        ended = not get_default_context().is_ok
        context = get_default_context(shutting_down=ended)
    context.init(args, domain_id=domain_id)
    wanted = SignalHandlerOptions.ALL if default else SignalHandlerOptions.NO
    wanted = wanted if signal_handler_options is None else signal_handler_options
    if threading.current_thread() is threading.main_thread() and not context.world.simulated:
        for number, flag in ((signal.SIGINT, 1), (signal.SIGTERM, 2)):
            if wanted & flag:
                _shut_down_at(number, context)


def _shut_down_at(number: signal.Signals, context: Context) -> None:
    before = signal.getsignal(number)

    def handle(signum: int, frame: Any) -> None:
        context.try_shutdown()
        if callable(before):
            before(signum, frame)

    signal.signal(number, handle)
    context.on_shutdown(
        lambda: (
            signal.signal(number, before)
            if threading.current_thread() is threading.main_thread()
            else None
        )
    )


def shutdown(*, context: Context | None = None, uninstall_handlers: bool | None = None) -> None:
    del uninstall_handlers
    (context or get_default_context()).shutdown()


def try_shutdown(*, context: Context | None = None, uninstall_handlers: bool | None = None) -> None:
    del uninstall_handlers
    (context or get_default_context()).try_shutdown()


def ok(*, context: Context | None = None) -> bool:
    context = context or get_default_context()
    if context.world.simulated:
        context.world.sleep(SECOND // 1000)  # a loop that asks comes to its end
    return context.is_ok


# QoS.


class HistoryPolicy(IntEnum):
    SYSTEM_DEFAULT = 0
    KEEP_LAST = 1
    KEEP_ALL = 2
    UNKNOWN = 3


class ReliabilityPolicy(IntEnum):
    SYSTEM_DEFAULT = 0
    RELIABLE = 1
    BEST_EFFORT = 2
    UNKNOWN = 3
    BEST_AVAILABLE = 4


class DurabilityPolicy(IntEnum):
    SYSTEM_DEFAULT = 0
    TRANSIENT_LOCAL = 1
    VOLATILE = 2
    UNKNOWN = 3
    BEST_AVAILABLE = 4


class LivelinessPolicy(IntEnum):
    SYSTEM_DEFAULT = 0
    AUTOMATIC = 1
    MANUAL_BY_TOPIC = 3
    UNKNOWN = 4
    BEST_AVAILABLE = 5


class QoSProfile:
    """What a publisher offers or a subscription requests; depth and durability count here."""

    def __init__(
        self,
        *,
        depth: int | None = None,
        history: HistoryPolicy | None = None,
        reliability: ReliabilityPolicy = ReliabilityPolicy.RELIABLE,
        durability: DurabilityPolicy = DurabilityPolicy.VOLATILE,
        lifespan: Duration | None = None,
        deadline: Duration | None = None,
        liveliness: LivelinessPolicy = LivelinessPolicy.SYSTEM_DEFAULT,
        liveliness_lease_duration: Duration | None = None,
        avoid_ros_namespace_conventions: bool = False,
    ) -> None:
        if history is None and depth is None:
            raise TypeError('History and/or depth settings are required.')
        self.history = history if history is not None else HistoryPolicy.KEEP_LAST
        self.depth = depth or 0
        self.reliability, self.durability = reliability, durability
        self.lifespan, self.deadline = lifespan or Duration(), deadline or Duration()
        self.liveliness = liveliness
        self.liveliness_lease_duration = liveliness_lease_duration or Duration()
        self.avoid_ros_namespace_conventions = avoid_ros_namespace_conventions

    def __eq__(self, other: object) -> bool:
        return isinstance(other, QoSProfile) and vars(self) == vars(other)

    __hash__ = None  # type: ignore[assignment]

    def __repr__(self) -> str:
        values = ', '.join(
            f'{name}={value.name if isinstance(value, IntEnum) else value}'
            for name, value in vars(self).items()
        )
        return f'{type(self).__name__}({values})'

    @property
    def length(self) -> int | None:
        """How many messages a queue holds; None: all."""
        return None if self.history == HistoryPolicy.KEEP_ALL else max(self.depth, 1)

    @property
    def latched(self) -> bool:
        """Whether the last messages are kept for subscriptions to come."""
        return self.durability == DurabilityPolicy.TRANSIENT_LOCAL

    def refuses(self, offered: QoSProfile) -> str:
        """Return the policy by which a subscription gets nothing of a publisher, or ''."""
        best_effort = offered.reliability == ReliabilityPolicy.BEST_EFFORT
        if best_effort and self.reliability == ReliabilityPolicy.RELIABLE:
            return 'RELIABILITY'
        return 'DURABILITY' if self.latched and not offered.latched else ''


def as_profile(qos: QoSProfile | int) -> QoSProfile:
    """Return a profile, which may be given as a depth."""
    if isinstance(qos, QoSProfile):
        return qos
    if not isinstance(qos, int):
        raise TypeError(f'Expected QoSProfile or int, but received {type(qos)!r}')
    if qos < 0:
        raise ValueError('history depth must be greater than or equal to zero')
    return QoSProfile(depth=qos)


qos_profile_services_default = QoSProfile(depth=10)
qos_profile_parameters = qos_profile_parameter_events = QoSProfile(depth=1000)
qos_profile_system_default = QoSProfile(
    depth=0,
    history=HistoryPolicy.SYSTEM_DEFAULT,
    reliability=ReliabilityPolicy.SYSTEM_DEFAULT,
    durability=DurabilityPolicy.SYSTEM_DEFAULT,
)
qos_profile_sensor_data = QoSProfile(depth=5, reliability=ReliabilityPolicy.BEST_EFFORT)
QOS_ROSOUT = QoSProfile(
    depth=1000, durability=DurabilityPolicy.TRANSIENT_LOCAL, lifespan=Duration(seconds=10)
)


# The log.


class LoggingSeverity(IntEnum):
    UNSET = 0
    DEBUG = 10
    INFO = 20
    WARN = 30
    ERROR = 40
    FATAL = 50


class Logger:
    """Writes to stderr and, for a node, to `/rosout`."""

    def __init__(self, name: str, world: World | None = None) -> None:
        self.name, self._world = name, world or current()
        self._places: dict[tuple[Any, int], float] = {}

    def get_child(self, name: str) -> Logger:
        if not name:
            raise ValueError('Child logger name must not be empty.')
        child = Logger(f'{self.name}.{name}' if self.name else name, self._world)
        if self.name in self._world.rosout:
            self._world.rosout[child.name] = self._world.rosout[self.name]
        return child

    def set_level(self, level: int) -> None:
        self._world.log_levels[self.name] = LoggingSeverity(level)

    def get_effective_level(self) -> LoggingSeverity:
        name = self.name
        while name and not self._world.log_levels.get(name):
            name = name.rpartition('.')[0]
        return LoggingSeverity(self._world.log_levels.get(name) or LoggingSeverity.INFO)

    def is_enabled_for(self, severity: int) -> bool:
        return severity >= self.get_effective_level()

    def log(self, message: str, severity: int, **filters: Any) -> bool:
        return self._log(message, severity, filters)

    def debug(self, message: str, **filters: Any) -> bool:
        return self._log(message, LoggingSeverity.DEBUG, filters)

    def info(self, message: str, **filters: Any) -> bool:
        return self._log(message, LoggingSeverity.INFO, filters)

    def warning(self, message: str, **filters: Any) -> bool:
        return self._log(message, LoggingSeverity.WARN, filters)

    warn = warning

    def error(self, message: str, **filters: Any) -> bool:
        return self._log(message, LoggingSeverity.ERROR, filters)

    def fatal(self, message: str, **filters: Any) -> bool:
        return self._log(message, LoggingSeverity.FATAL, filters)

    def _log(self, message: str, severity: int, filters: dict[str, Any]) -> bool:
        if self._world.silent or not self.is_enabled_for(severity):
            return False
        frame = sys._getframe(2)  # noqa: SLF001 (who logs)
        if filters and not self._passes((frame.f_code, frame.f_lineno), **filters):
            return False
        now, level = self._world.date(), LoggingSeverity(severity).name
        form = (
            os.environ.get('RCUTILS_CONSOLE_OUTPUT_FORMAT')
            or '[{severity}] [{time}] [{name}]: {message}'
        )
        stamp = f'{now // SECOND}.{now % SECOND:09d}'
        for key, text in (
            ('severity', level),
            ('time', stamp),
            ('name', self.name),
            ('message', message),
        ):
            form = form.replace(f'{{{key}}}', text)
        print(form, file=sys.stderr, flush=True)  # noqa: T201
        if publisher := self._world.rosout.get(self.name):
            publisher.publish(
                message_type('rcl_interfaces/msg/Log')(
                    stamp=message_type('builtin_interfaces/msg/Time')(
                        sec=now // SECOND, nanosec=now % SECOND
                    ),
                    level=int(severity),
                    name=self.name,
                    msg=message,
                    file=frame.f_code.co_filename,
                    function=frame.f_code.co_name,
                    line=frame.f_lineno,
                )
            )
        return True

    def _passes(
        self,
        place: tuple[Any, int],
        *,
        throttle_duration_sec: float = 0.0,
        throttle_time_source_type: Clock | None = None,
        skip_first: bool = False,
        once: bool = False,
        name: str = '',
    ) -> bool:
        """Return whether the filters of a call at `place` let its message pass."""
        del name
        if throttle_duration_sec:
            source = throttle_time_source_type or Clock()
            now = source.now().nanoseconds
            if now < self._places.get(place, -float('inf')) + throttle_duration_sec * SECOND:
                return False
            self._places[place] = now
        elif skip_first or once:
            again = place in self._places
            self._places[place] = 0.0
            return again if skip_first else not again
        return True


def get_logger(name: str) -> Logger:
    return Logger(name)


def set_logger_level(name: str, level: int, **_: Any) -> None:
    Logger(name).set_level(level)


def get_logger_level(name: str) -> LoggingSeverity:
    return LoggingSeverity(current().log_levels.get(name, 0))


def get_logger_effective_level(name: str) -> LoggingSeverity:
    return Logger(name).get_effective_level()
