"""A time budget for calls of code that may never return."""

from __future__ import annotations

import ctypes
import sys
import threading
import time
import weakref
from threading import get_ident
from typing import TYPE_CHECKING, ParamSpec, TypeVar

if TYPE_CHECKING:
    from collections.abc import Callable
    from types import FrameType

    _Trace = Callable[[FrameType, str, object], object]

    _P = ParamSpec('_P')
    _T = TypeVar('_T')

_POLL = 0.05
_raise_in_thread = ctypes.pythonapi.PyThreadState_SetAsyncExc


class OutOfTime(BaseException):
    """Raised in a call that has used up its budget; `except Exception` lets it by."""

    def __init__(self) -> None:
        """Strike again at the next line of code that has caught it.

        In a loop around a `try` that catches all it would else be caught each time.
        """
        super().__init__()
        frame: FrameType | None = sys._getframe(1)  # noqa: SLF001 (where it strikes or is caught)
        # Ours are to tidy up undisturbed.
        while frame and not str(frame.f_globals.get('__name__')).startswith('barc_sim.'):
            frame.f_trace = _strike
            sys.settrace(_ignore)
            frame = frame.f_back


def _strike(_: FrameType, event: str, __: object) -> _Trace:
    if event == 'line':
        raise OutOfTime
    return _strike


def _ignore(_: FrameType, __: str, ___: object) -> None:
    """Trace no new frame."""


class Budget:
    """Ends calls that take longer than `seconds`, in whichever thread they are made.

    A thread looks twenty times a second whether the call of last time still runs, so that a call
    costs a fraction of a microsecond, and time in which the whole process stood still is not
    counted. Calls are ended between two bytecodes; one in C, as of `time.sleep`, ends when
    it returns. Not for calls within calls, nor for several threads at once.
    """

    def __init__(self, seconds: float) -> None:
        """Allow `seconds` to each call."""
        self.seconds = seconds
        self._caller = 0
        self._trace = sys.gettrace()
        self._turn = self._seen = self._polls = 0
        self._busy = self._fired = False
        self._lock = threading.RLock()
        self._start()

    def call(self, function: Callable[_P, _T], /, *args: _P.args, **kwargs: _P.kwargs) -> _T:
        """Return what `function` returns, raise what it raises, or OutOfTime."""
        self._caller = get_ident()
        self._trace = sys.gettrace()
        self._turn += 1
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
        """Take back what has been fired and has not yet hit."""
        with self._lock:
            try:
                # In the place of the one that may be waiting. To take that back with NULL would
                # leave the interpreter looking for it for ever, and Python 3.11 hanging where it
                # is traced.
                self._fire()
                while True:
                    pass
            except OutOfTime:
                self._fired = False
            sys.settrace(self._trace)

    def _fire(self) -> None:
        _raise_in_thread(ctypes.c_ulong(self._caller), ctypes.py_object(OutOfTime))

    def _look(self) -> None:
        if not self._busy or self._turn != self._seen:
            self._seen = self._turn
            self._polls = 0
            return
        self._polls += 1
        if self._polls * _POLL < self.seconds:
            return
        with self._lock:
            # Told before it is looked again: a call that ends in between takes it back.
            self._fired = True
            if self._busy and self._turn == self._seen:
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
        budget._look()  # noqa: SLF001
        del budget
