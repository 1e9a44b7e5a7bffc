"""The protocol between the grader and a submission's process: frames of doubles.

A request is `REQUEST` (serial, operation, count) and `count` doubles, a reply `REPLY` (serial,
status, count) and `count` doubles, or bytes of UTF-8 where the status is `FAILED`. A frame
holds only numbers and text, so that a forged reply is at worst a wrong result. The process sends
the first frame by itself, with the serial 0: it is confined, or could not be confined.
"""

from __future__ import annotations

from enum import IntEnum
from struct import Struct

REQUEST = Struct('=III')
REPLY = Struct('=III')

MODEL_COLUMNS = 11  #: of a row for bikeFE: its positional arguments
STATE_COLUMNS = 4  #: of its result
STEP_COLUMNS = 3  #: of a row for a controller: reference, current [m/s], dt [s]
TWIST_COLUMNS = 3  #: of a row for a relay: time [s], linear.x, angular.z
COMMAND_COLUMNS = 3  #: of its result: time [s], motor [m/s²], servo [rad]
NO_PIPES = 97  #: exit code of a process whose pipes have been closed
NOTES_COLUMNS = 2000
MAX_TEXT = 4000  #: bytes of a message; what is longer is cut


class Operation(IntEnum):
    """The kind of a request."""

    MODEL = 1  #: l_f, l_r [m], rows for bikeFE -> rows of states
    NEW_PID = 2  #: kp, ki, kd, limit [m/s²], whether to load its file again -> its number
    STEPS = 3  #: a controller's number, rows -> its outputs [m/s²], one after the other
    RESET = 4  #: a controller's number -> 1, or 0 without a `reset`
    RELAY = 6  #: duration [s], rows of Twists -> count, rows of commands, 0 after them
    NOTES = 5  #: -> `NOTES_COLUMNS` code points of a JSON text, 0 after its end


class Status(IntEnum):
    """The kind of a reply."""

    DONE = 0
    FAILED = 1


def doubles(count: int) -> Struct:
    """Return the layout of `count` doubles."""
    return Struct(f'={count}d')
