"""What a process does to itself before it runs a submission's code; there is no way back."""

from __future__ import annotations

import ctypes
import os
import resource
import signal

from barc_sim.lab.grade import landlock, seccomp

_SET_PDEATHSIG, _SET_DUMPABLE, _SET_SECCOMP, _SET_NO_NEW_PRIVS = 1, 4, 22, 38
_MODE_FILTER = 2
_INSTRUCTION = 8  # bytes


def limit_resources(memory: int, cpu: int, parent: int) -> None:
    """Bound memory [bytes], processor time [s] and files; die with the process id `parent`."""
    _prctl(_SET_PDEATHSIG, signal.SIGKILL)
    if os.getppid() != parent:
        # It has died before that was said.
        os._exit(1)
    _prctl(_SET_DUMPABLE, 0)
    for kind, amount in (
        (resource.RLIMIT_AS, memory),
        (resource.RLIMIT_CPU, cpu),
        (resource.RLIMIT_FSIZE, 0),
        (resource.RLIMIT_CORE, 0),
        (resource.RLIMIT_NOFILE, 64),
        (resource.RLIMIT_NPROC, 0),
    ):
        # A hard limit that is lower already stays.
        hard = resource.getrlimit(kind)[1]
        amount = amount if hard == resource.RLIM_INFINITY else min(amount, hard)  # noqa: PLW2901
        resource.setrlimit(kind, (amount, amount))


def close_in(ruleset: int) -> None:
    """Allow only the files of the Landlock `ruleset` and harmless system calls from now on.

    Raises
    ------
    OSError
        where the kernel does not do that.
    """
    _prctl(_SET_NO_NEW_PRIVS, 1)
    landlock.restrict_self(ruleset)
    os.close(ruleset)
    code = seccomp.program()
    buffer = ctypes.create_string_buffer(code, len(code))
    filter_program = _FilterProgram(len(code) // _INSTRUCTION, ctypes.addressof(buffer))
    _prctl(_SET_SECCOMP, _MODE_FILTER, ctypes.addressof(filter_program))


class _FilterProgram(ctypes.Structure):
    _fields_ = (('length', ctypes.c_ushort), ('filter', ctypes.c_void_p))


def _prctl(option: int, *arguments: int) -> None:
    wide = [ctypes.c_ulong(a) for a in (*arguments, *(0,) * (4 - len(arguments)))]
    if ctypes.CDLL(None, use_errno=True).prctl(option, *wide):
        error = ctypes.get_errno()
        raise OSError(error, f'prctl {option} failed: {os.strerror(error)}')
