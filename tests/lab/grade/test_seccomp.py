"""The filter of system calls, run here in an interpreter of its few instructions."""

from __future__ import annotations

from errno import ENOTTY, EPERM
from struct import iter_unpack, pack

import pytest

from barc_sim.lab.grade.seccomp import MACHINES, program

ALLOWED, KILLED, ERRNO = 0x7FFF0000, 0x80000000, 0x00050000
REFUSED = ERRNO | EPERM
NAMES = {
    'x86_64': {
        'read': 0, 'write': 1, 'close': 3, 'mmap': 9, 'munmap': 11, 'brk': 12, 'openat': 257,
        'getrandom': 318, 'exit_group': 231, 'faccessat2': 439, 'futex': 202,
        'socket': 41, 'connect': 42, 'clone': 56, 'fork': 57, 'vfork': 58, 'execve': 59,
        'kill': 62, 'truncate': 76, 'unlink': 87, 'chmod': 90, 'ptrace': 101, 'prctl': 157,
        'mount': 165, 'tkill': 200, 'tgkill': 234, 'keyctl': 250, 'process_vm_readv': 310,
        'execveat': 322, 'pidfd_send_signal': 424, 'io_uring_setup': 425, 'pidfd_open': 434,
        'clone3': 435, 'landlock_create_ruleset': 444,
    },
    'aarch64': {
        'read': 63, 'write': 64, 'close': 57, 'mmap': 222, 'munmap': 215, 'brk': 214, 'openat': 56,
        'getrandom': 278, 'exit_group': 94, 'faccessat2': 439, 'futex': 98,
        'socket': 198, 'connect': 203, 'clone': 220, 'execve': 221, 'kill': 129, 'truncate': 45,
        'unlinkat': 35, 'fchmodat': 53, 'ptrace': 117, 'prctl': 167, 'mount': 40, 'tkill': 130,
        'tgkill': 131, 'keyctl': 219, 'process_vm_readv': 270, 'execveat': 281,
        'pidfd_send_signal': 424, 'io_uring_setup': 425, 'pidfd_open': 434, 'clone3': 435,
        'landlock_create_ruleset': 444,
    },
}  # fmt: skip
HARMLESS = {
    'read', 'write', 'close', 'mmap', 'munmap', 'brk', 'openat', 'getrandom', 'exit_group',
    'faccessat2', 'futex',
}  # fmt: skip
CALLS = [(machine, name) for machine, names in NAMES.items() for name in names]


def decide(machine: str, number: int, *arguments: int, audit: int | None = None) -> int:
    """Return what the filter for `machine` says of a system call."""
    padded = (*arguments, *(0,) * (6 - len(arguments)))
    audit = MACHINES[machine].audit if audit is None else audit
    data = pack('=IIQ6Q', number, audit, 0, *padded)
    instructions: list[tuple[int, int, int, int]] = [
        *iter_unpack('=HBBI', program(MACHINES[machine]))
    ]
    at = accumulator = 0
    while True:
        code, if_equal, otherwise, operand = instructions[at]
        at += 1
        if code == 0x06:
            return operand
        if code == 0x20:
            accumulator = int.from_bytes(data[operand : operand + 4], 'little')
        else:
            assert code == 0x15
            at += if_equal if accumulator == operand else otherwise


@pytest.mark.parametrize(('machine', 'name'), CALLS)
def test_only_harmless_calls_are_allowed(machine: str, name: str) -> None:
    expected = ALLOWED if name in HARMLESS else REFUSED

    assert decide(machine, NAMES[machine][name]) == expected


@pytest.mark.parametrize('machine', MACHINES)
def test_calls_of_later_kernels_are_refused(machine: str) -> None:
    assert decide(machine, 4_000) == REFUSED


@pytest.mark.parametrize('machine', MACHINES)
def test_calls_by_another_architectures_numbers_kill(machine: str) -> None:
    assert decide(machine, NAMES[machine]['read'], audit=0x40000003) == KILLED


def test_calls_by_the_numbers_of_x32_are_refused() -> None:
    assert decide('x86_64', 0x40000000) == REFUSED


@pytest.mark.parametrize('machine', MACHINES)
@pytest.mark.parametrize(
    ('command', 'expected'),
    [(0, ALLOWED), (3, ALLOWED), (1030, ALLOWED), (4, REFUSED), (8, REFUSED), (10, REFUSED)],
)
def test_a_descriptor_can_be_duplicated_but_not_made_to_send_signals(
    machine: str, command: int, expected: int
) -> None:
    assert decide(machine, MACHINES[machine].number('fcntl'), 0, command) == expected


@pytest.mark.parametrize('machine', MACHINES)
@pytest.mark.parametrize(
    ('new_limits', 'expected'), [(0, ALLOWED), (0x1000, REFUSED), (1 << 40, REFUSED)]
)
def test_limits_can_be_read_but_not_set(machine: str, new_limits: int, expected: int) -> None:
    assert decide(machine, MACHINES[machine].number('prlimit64'), 0, 9, new_limits) == expected


@pytest.mark.parametrize('machine', MACHINES)
def test_nothing_is_a_terminal(machine: str) -> None:
    assert decide(machine, MACHINES[machine].number('ioctl'), 0, 0x5401) == ERRNO | ENOTTY


def test_there_is_no_filter_for_an_unknown_machine(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr('platform.machine', lambda: 'sparc64')

    with pytest.raises(OSError, match="'sparc64' machine, only for x86_64 and aarch64"):
        program()
