"""What passes between the grader and the process a submission runs in: frames of doubles.

A request is `REQUEST` (serial, operation, count) and `count` doubles, a reply `REPLY` (serial,
status, count) and `count` doubles, or bytes of UTF-8 where the status is `FAILED`. Nothing here can
hold more than numbers and text, so that a reply which a submission has forged is at worst a wrong
answer. The first frame comes from the process, unasked, with the serial 0: it is confined now, or
could not be.
"""

from __future__ import annotations

from enum import IntEnum
from struct import Struct

REQUEST = Struct('=III')
REPLY = Struct('=III')

MODEL_COLUMNS = 11  #: of a row for bikeFE: its positional arguments
STATE_COLUMNS = 4  #: of its answer
STEP_COLUMNS = 3  #: of a row for a controller: reference, current [m/s], dt [s]
NO_PIPES = 97  #: exit code of a process whose pipes have been closed
MAX_TEXT = 4000  #: bytes of a message; what is longer is cut


class Operation(IntEnum):
    """What is asked for."""

    MODEL = 1  #: l_f, l_r [m], rows for bikeFE -> rows of states
    NEW_PID = 2  #: kp, ki, kd, output_min, output_max [m/s²] -> the new controller's number
    STEPS = 3  #: a controller's number, rows -> its outputs [m/s²], one after the other
    RESET = 4  #: a controller's number -> 1, or 0 where it has no `reset`


class Status(IntEnum):
    """What became of it."""

    DONE = 0
    FAILED = 1


def doubles(count: int) -> Struct:
    """Return the layout of `count` doubles."""
    return Struct(f'={count}d')
