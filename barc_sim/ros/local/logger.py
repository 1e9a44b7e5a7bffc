"""Loggers, which write to stderr and to the topic `/rosout`."""

from __future__ import annotations

import sys
from enum import IntEnum
from typing import Any

from barc_sim.ros.local.messages import message_type
from barc_sim.ros.local.world import SECOND, World, current

LoggingSeverity = IntEnum(
    'LoggingSeverity', {'UNSET': 0, 'DEBUG': 10, 'INFO': 20, 'WARN': 30, 'ERROR': 40, 'FATAL': 50}
)


class Logger:
    """Writes to stderr and, for a node, to `/rosout`.

    The methods that log take `once`, and `throttle_duration_sec` [s]: a line of code logs once, or
    at most once in this time.

    Parameters
    ----------
    name
        Its name, such as that of a node.
    world
        The world of the node.
    rosout
        The publisher of `/rosout`; None: there is none.
    """

    def __init__(self, name: str, world: World, rosout: Any = None) -> None:
        self.name = name
        self._world = world
        self.rosout = rosout
        self._last: dict[tuple[Any, int], float] = {}  # [s] of the last log, by line of code

    def set_level(self, level: int) -> None:
        """Log messages of this level, and above, from now on."""
        self._world.log_levels[self.name] = level

    def get_effective_level(self) -> LoggingSeverity:
        """Return the level of this logger, or else of the one above it that has one."""
        name = self.name
        levels = self._world.log_levels
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

        frame = sys._getframe(2)  # noqa: SLF001 (of the caller of `info` or the like)
        place = (frame.f_code, frame.f_lineno)
        now = self._world.now() / SECOND
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
            log.stamp.sec = sec
            log.stamp.nanosec = nanosec
            log.file = frame.f_code.co_filename
            log.function = frame.f_code.co_name
            log.line = frame.f_lineno
            self.rosout.publish(log)
        return True

    def debug(self, message: str, **options: Any) -> bool:
        """Log a message of the level DEBUG; return whether it was logged."""
        return self._log(LoggingSeverity.DEBUG, message, **options)

    def info(self, message: str, **options: Any) -> bool:
        """Log a message of the level INFO; return whether it was logged."""
        return self._log(LoggingSeverity.INFO, message, **options)

    def warning(self, message: str, **options: Any) -> bool:
        """Log a message of the level WARN; return whether it was logged."""
        return self._log(LoggingSeverity.WARN, message, **options)

    def warn(self, message: str, **options: Any) -> bool:
        """Do the same as `warning`."""
        return self._log(LoggingSeverity.WARN, message, **options)

    def error(self, message: str, **options: Any) -> bool:
        """Log a message of the level ERROR; return whether it was logged."""
        return self._log(LoggingSeverity.ERROR, message, **options)

    def fatal(self, message: str, **options: Any) -> bool:
        """Log a message of the level FATAL; return whether it was logged."""
        return self._log(LoggingSeverity.FATAL, message, **options)


def get_logger(name: str) -> Logger:
    """Return a logger without a node."""
    return Logger(name, current())
