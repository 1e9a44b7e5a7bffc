"""A time budget for calls of code that might never return."""

from __future__ import annotations

import ctypes
import sys
import threading
import time
import weakref
from threading import get_ident
from typing import TYPE_CHECKING, ClassVar, ParamSpec, TypeVar

if TYPE_CHECKING:
    from collections.abc import Callable
    from types import FrameType

    _Trace = Callable[[FrameType, str, object], object]

    _P = ParamSpec('_P')
    _T = TypeVar('_T')

_POLL = 0.05
_raise_in_thread = ctypes.pythonapi.PyThreadState_SetAsyncExc


class OutOfTime(BaseException):
    """Raised in a call that has used up its budget; `except Exception` does not catch it."""

    seconds: ClassVar[float] = 0.0  #: of a call, in a process that an alarm interrupts

    def __init__(self) -> None:
        """Raise it again at the next line of code that catches it.

        Otherwise a loop around a `try` that catches everything would never end.
        """
        super().__init__()
        frame: FrameType | None = sys._getframe(1)  # noqa: SLF001 (where it is raised or caught)
        # Frames of barc_sim clean up undisturbed.
        while frame and not str(frame.f_globals.get('__name__')).startswith('barc_sim.'):
            frame.f_trace = _raise_again
            sys.settrace(_ignore)
            frame = frame.f_back


def _raise_again(_: FrameType, event: str, __: object) -> _Trace:
    if event == 'line':
        raise OutOfTime
    return _raise_again


def _ignore(_: FrameType, __: str, ___: object) -> None:
    """Trace no new frame."""


class Budget:
    """Ends calls that take longer than `seconds`, in whichever thread they are made.

    A thread checks twenty times a second whether the same call still runs. So a call costs a
    fraction of a microsecond, and time in which the whole process is stopped does not count. A
    call ends between two bytecodes; a call in C, such as `time.sleep`, ends when it returns. Not
    for nested calls, nor for several threads at once.
    """

    def __init__(self, seconds: float) -> None:
        """Allow `seconds` to each call."""
        self.seconds = seconds
        self._caller = 0
        self._trace = sys.gettrace()
        self._count = self._seen = self._polls = 0
        self._busy = self._fired = False
        self._lock = threading.RLock()
        self._start()

    def call(self, function: Callable[_P, _T], /, *args: _P.args, **kwargs: _P.kwargs) -> _T:
        """Return what `function` returns, raise what it raises, or OutOfTime."""
        self._caller = get_ident()
        self._trace = sys.gettrace()
        self._count += 1
        self._busy = True
        try:
            try:
                return function(*args, **kwargs)
            finally:
                self._busy = False
                if self._fired:
                    self._settle()
        except OutOfTime:
            self._busy = False
            self._settle()
            raise

    def _settle(self) -> None:
        """Cancel an exception that is sent and not yet raised."""
        with self._lock:
            try:
                # This one replaces the one that may be pending. Cancelling with NULL would leave
                # the interpreter checking for it for ever, and Python 3.11 hangs under a tracer.
                self._fire()
                while True:
                    pass
            except OutOfTime:
                self._fired = False
            sys.settrace(self._trace)

    def _fire(self) -> None:
        _raise_in_thread(ctypes.c_ulong(self._caller), ctypes.py_object(OutOfTime))

    def _check(self) -> None:
        if not self._busy or self._count != self._seen:
            self._seen = self._count
            self._polls = 0
            return
        self._polls += 1
        if self._polls * _POLL < self.seconds:
            return
        with self._lock:
            # Set before the second check: a call that ends in between cancels the exception.
            self._fired = True
            if self._busy and self._count == self._seen:
                self._fire()

    def _start(self) -> None:
        thread = threading.Thread(
            target=_watch, args=[weakref.ref(self)], name='time budget', daemon=True
        )
        thread.start()


def _watch(reference: weakref.ref[Budget]) -> None:
    while True:
        time.sleep(_POLL)
        budget = reference()
        if budget is None:
            return
        budget._check()  # noqa: SLF001
        del budget
