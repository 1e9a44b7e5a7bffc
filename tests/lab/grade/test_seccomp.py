"""The filter of system calls, run here in an interpreter of its few instructions."""

from __future__ import annotations

import os
from errno import ENOTTY, EPERM
from struct import iter_unpack, pack

import pytest

from barc_sim.lab.confined.kernel import MACHINES, numbers, program

ALLOWED, KILLED, ERRNO = 0x7FFF0000, 0x80000000, 0x00050000
REFUSED = ERRNO | EPERM
#: Numbers from the kernel's headers, x86-64 and aarch64, to check the library's tables.
NUMBERS = {'read': (0, 63), 'openat': (257, 56), 'futex': (202, 98), 'execve': (59, 221)}
HARMLESS = """
    read write close mmap munmap brk openat getrandom exit_group faccessat2 futex
""".split()  # noqa: SIM905
HARMFUL = """
    socket connect clone execve kill truncate unlinkat fchmodat ptrace prctl mount tkill tgkill
    keyctl process_vm_readv execveat pidfd_send_signal io_uring_setup pidfd_open clone3
    landlock_create_ruleset openat2 fcntl prlimit64
""".split()  # noqa: SIM905

READS = (os.O_RDONLY | os.O_CLOEXEC, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, os.O_RDWR | os.O_TRUNC)
EMPTIES = (os.O_TRUNC, 3 | os.O_TRUNC, os.O_TRUNC | os.O_CLOEXEC | 1 << 40)


def decide(machine: str, number: int, *arguments: int, audit: int | None = None) -> int:
    """Return the filter's answer to a system call on `machine`."""
    padded = (*arguments, *(0,) * (6 - len(arguments)))
    audit = MACHINES[machine][1] if audit is None else audit
    data = pack('=IIQ6Q', number, audit, 0, *padded)
    instructions: list[tuple[int, int, int, int]] = [*iter_unpack('=HBBI', program(machine))]
    at = accumulator = 0
    while True:
        code, if_equal, otherwise, operand = instructions[at]
        at += 1
        if code == 0x06:
            return operand
        if code == 0x20:
            accumulator = int.from_bytes(data[operand : operand + 4], 'little')
        elif code == 0x54:
            accumulator &= operand
        else:
            assert code == 0x15
            at += if_equal if accumulator == operand else otherwise


@pytest.mark.parametrize('machine', MACHINES)
def test_only_harmless_calls_are_allowed(machine: str) -> None:
    for names, answer in ((HARMLESS, ALLOWED), (HARMFUL, REFUSED)):
        found = {decide(machine, number) for number in numbers(machine, names).values()}
        assert found == {answer}
    assert decide(machine, 4_000) == REFUSED  # of a later kernel
    read, ioctl = numbers(machine, ('read', 'ioctl')).values()
    assert decide(machine, read, audit=0x40000003) == KILLED  # of another architecture
    assert decide(machine, ioctl, 0, 0x5401) == ERRNO | ENOTTY


def test_names_have_the_numbers_of_the_kernel() -> None:
    for place, machine in enumerate(MACHINES):
        assert numbers(machine, NUMBERS) == {name: each[place] for name, each in NUMBERS.items()}


@pytest.mark.parametrize('call', [57, 58, 76, 87, 90, 0x40000000])
def test_old_calls_of_x86_64_are_refused(call: int) -> None:
    """Fork, vfork, truncate, unlink and chmod, which the other architecture lacks; and x32."""
    assert decide('x86_64', call) == REFUSED


@pytest.mark.parametrize(
    ('machine', 'call', 'at'),
    [('x86_64', 'open', 1), ('x86_64', 'openat', 2), ('aarch64', 'openat', 2)],
)
def test_a_file_is_not_emptied_by_opening_it(machine: str, call: str, at: int) -> None:
    """Of writing, Landlock decides."""
    (number,) = numbers(machine, [call]).values()
    found = [decide(machine, number, *[0] * at, flags) for flags in (*READS, *EMPTIES)]
    assert found == [ALLOWED] * len(READS) + [REFUSED] * len(EMPTIES)


def test_there_is_no_filter_for_an_unknown_machine(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr('platform.machine', lambda: 'sparc64')

    with pytest.raises(OSError, match="'sparc64' machine, only for x86_64 and aarch64"):
        program()
