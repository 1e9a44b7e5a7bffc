"""Confines this process, for ever, before it runs a submission's code."""

from __future__ import annotations

import ctypes
import os
import signal

from barc_sim.lab.grade import landlock

_SET_PDEATHSIG, _SET_DUMPABLE, _SET_SECCOMP, _SET_NO_NEW_PRIVS = 1, 4, 22, 38
_MODE_FILTER = 2
_INSTRUCTION = 8  # bytes


def limit_resources(memory: int, cpu: int, parent: int) -> None:
    """Limit memory [bytes], processor time [s] and files; end with the process `parent`."""
    import resource  # noqa: PLC0415 (not on Windows)

    _prctl(_SET_PDEATHSIG, signal.SIGKILL)
    if os.getppid() != parent:
        # It has already ended.
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
        # A lower hard limit stays.
        hard = resource.getrlimit(kind)[1]
        amount = amount if hard == resource.RLIM_INFINITY else min(amount, hard)  # noqa: PLW2901
        resource.setrlimit(kind, (amount, amount))


def confine(ruleset: int, program: bytes) -> None:
    """Allow only the files of a Landlock `ruleset`, and the system calls of a seccomp `program`.

    Raises
    ------
    OSError
        if the kernel cannot do that.
    """
    _prctl(_SET_NO_NEW_PRIVS, 1)
    landlock.restrict_self(ruleset)
    os.close(ruleset)
    buffer = ctypes.create_string_buffer(program, len(program))
    filter_program = _FilterProgram(len(program) // _INSTRUCTION, ctypes.addressof(buffer))
    _prctl(_SET_SECCOMP, _MODE_FILTER, ctypes.addressof(filter_program))


class _FilterProgram(ctypes.Structure):
    _fields_ = (('length', ctypes.c_ushort), ('filter', ctypes.c_void_p))


def _prctl(option: int, *arguments: int) -> None:
    wide = [ctypes.c_ulong(a) for a in (*arguments, *(0,) * (4 - len(arguments)))]
    if ctypes.CDLL(None, use_errno=True).prctl(option, *wide):
        error = ctypes.get_errno()
        raise OSError(error, f'prctl {option} failed: {os.strerror(error)}')
