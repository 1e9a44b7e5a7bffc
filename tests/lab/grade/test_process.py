"""A submission's functions, called in another process; what it can't do is tried from within."""

from __future__ import annotations

import os
import re
import sys
from contextlib import suppress
from errno import ENOTTY, EPERM
from pathlib import Path
from random import Random
from struct import iter_unpack, pack
from typing import TYPE_CHECKING

import pytest
from user_files import CONTROLLER, MODEL, user_text

import barc_sim
from barc_sim.control.speed import PID
from barc_sim.errors import UserError
from barc_sim.lab.confined import process
from barc_sim.lab.confined.child import MACHINES, call_filter, call_numbers
from barc_sim.lab.confined.process import JudgedCode, ProcessLimits, check_confinement
from barc_sim.lab.grade.grade import grade, gradescope, load_rubric
from barc_sim.lab.labs.relay import relay_commands
from barc_sim.lab.submission import read_submission

if TYPE_CHECKING:
    from collections.abc import Callable

pytestmark = pytest.mark.usefixtures('confinement')

ROW = [0.0] * 11
QUICK = ProcessLimits(call=0.3)
#: For what never ends by itself, nor by its processor time.
BRIEF = ProcessLimits(call=0.3, wait=2.0)
BIKE_FE = """
def bikeFE(x, y, psi, v, a, d_f, a0, m, Ff, theta, ts):
    return [1.0, 2.0, 3.0, 4.0]
"""
_TO_ALL = 'for i in range(3, 64):\n try: os.write(i, {})\n except OSError: pass'
#: Each is refused with an exception, which names the reason.
REFUSED = {
    'write into its own folder': ("os.open('results.json', os.O_CREAT | 1)", 'Permission denied'),
    'write elsewhere': ("os.open('/tmp/results.json', os.O_CREAT | 1)", 'Permission denied'),
    'delete its own file': ("os.unlink('bike_model.py')", 'not permitted'),
    'read the rubric': (
        f'open({str(Path(barc_sim.__file__).parent / "lab" / "grade" / "rubrics" / "lab.yaml")!r})',
        'Permission denied',
    ),
    'read the reference': (f'open({barc_sim.__file__!r})', 'Permission denied'),
    'import the reference': (
        'import barc_sim.vehicle.bike_model as m; 1.0 + m.GRAVITY',
        'ModuleNotFoundError',
    ),
    'import another package': ('import yaml; 1 + yaml.load(1)', 'ModuleNotFoundError'),
    'import what confines it': (
        'import system_calls; 1 + len(system_calls.syscalls())',
        'ModuleNotFoundError',
    ),
    'read its neighbour': ("open('../neighbour/bike_model.py')", 'Permission denied'),
    'read passwords': ("open('/etc/passwd')", 'Permission denied'),
    'list the submissions': ("os.listdir('..')", 'Permission denied'),
    "read its parent's memory": (
        "open(f'/proc/{os.getppid()}/mem', 'rb')",
        'Permission denied|No such file',
    ),
    "read its parent's environment": (
        "open(f'/proc/{os.getppid()}/environ', 'rb')",
        'Permission denied',
    ),
    'fork': ('os.fork()', 'not permitted'),
    'start a thread': ('import threading; threading.Thread(target=print).start()', "can't start"),
    'start a program': ("import subprocess; subprocess.run(['true'])", 'not permitted'),
    'replace itself': (f'os.execv({sys.executable!r}, ["python"])', 'not permitted'),
    'kill its parent': ('os.kill(os.getppid(), 9)', 'not permitted'),
    'kill everybody': ('os.kill(-1, 9)', 'not permitted'),
    'have the kernel kill its parent': (
        'import fcntl; fcntl.fcntl(0, fcntl.F_SETOWN, os.getppid())',
        'not permitted',
    ),
    'open a socket': ('import socket; socket.socket()', 'not permitted'),
    'raise its limits': (
        'import resource; resource.setrlimit(resource.RLIMIT_CPU, (-1, -1))',
        'not allowed',
    ),
    'eat memory': ('bytearray(1 << 34)', 'MemoryError'),
    'eat memory in pieces': ('[bytearray(1 << 24) for _ in range(1 << 20)]', 'MemoryError'),
    'leave': ('raise SystemExit', 'SystemExit'),
    'recurse without end': ('f = lambda: f(); f()', 'RecursionError'),
}
#: Each ends the process, or has it ended.
FATAL = {
    'exit at once': ('os._exit(0)', 'ended itself with exit code 0'),
    'loop without end': (
        'while True: pass',
        'line 2: loading the file took longer than 0.3 s: is there an endless',
    ),
    'print without end': ('while True: print("spam")', 'longer than'),
    'crash': ('import ctypes; ctypes.string_at(0)', 'SIGSEGV'),
    'close all files': ('os.closerange(0, 100)', "the grader's files"),
    'write to all files': (_TO_ALL.format('bytes(range(1, 100))'), "the grader's files"),
    'forge an answer and stall': (
        _TO_ALL.format('b\'{"serial": 1, "result": [[1.0,\'') + '\nwhile True: pass',
        "the grader's files",
    ),
}
#: Each ends at the time limit of a request at the latest.
STUBBORN = {
    'catch everything, and loop': (
        'while True:\n try:\n  while True: pass\n except BaseException: pass',
        'longer than 0.3 s|within 2 s',
    ),
    'ignore the alarm': (
        'import signal; signal.signal(signal.SIGPROF, signal.SIG_IGN)\nwhile True: pass',
        'did not answer within 2 s: does the code sleep, or loop without end',
    ),
}
#: None is anybody's harm.
ALLOWED = {
    'use NumPy': 'import numpy as np; assert np.linalg.det(np.eye(100)) == 1.0',
    'use the standard library': 'import decimal, hashlib, json, random, sqlite3, ssl, statistics',
    'read its own files': "assert 'bikeFE' in open('bike_model.py').read()",
    'import its own modules': 'import helper; assert helper.ANSWER == 42',
    'write to nowhere': "print('hello', file=open(os.devnull, 'w'))",
    'write what is dropped': "for mode in 'wax': print('hello', file=open('results.json', mode))",
    'write what is dropped, by pathlib': "import pathlib; pathlib.Path('a').write_text('hello')",
    'write what is dropped, by logging': "import logging; logging.FileHandler('/tmp/a.log')",
    'close its output': 'os.close(1); os.close(2)',
    'have nothing in its environment': "assert not {'HOME', 'PATH'} & {*os.environ}",
}


def asked(
    folder: Callable[..., Path], code: str, *, limits: ProcessLimits = QUICK
) -> list[tuple[float, ...]]:
    path = folder(bike_model=f'import os\n{code}\n{BIKE_FE}', helper='ANSWER = 42')
    folder('neighbour', bike_model=BIKE_FE)
    with JudgedCode(path, limits) as confined:
        return [*confined.rows('bikeFE', [ROW])]


def test_confined_code_cannot_read_write_connect_or_start_processes(
    folder: Callable[..., Path],
) -> None:
    folder('neighbour', bike_model=BIKE_FE)
    attempts = ''.join(
        f'try:\n    {code}\n    print("done")\n'
        'except BaseException as error:\n    print(type(error).__name__, error)\n'
        for code, _ in REFUSED.values()
    )
    with JudgedCode(
        folder(bike_model=f'import os\n{attempts}\n{BIKE_FE}'), ProcessLimits(memory=1 << 28)
    ) as code:
        code.rows('bikeFE', [ROW])

    for name, (_, reason), line in zip(
        REFUSED, REFUSED.values(), code.printed.splitlines(), strict=True
    ):
        assert re.search(reason, line), f'{name}: {line}'


@pytest.mark.parametrize(('code', 'reason'), FATAL.values(), ids=FATAL)
def test_code_that_breaks_its_process_gets_an_error(
    folder: Callable[..., Path], code: str, reason: str
) -> None:
    with pytest.raises(UserError, match=reason):
        asked(folder, code)


@pytest.mark.parametrize(('code', 'reason'), STUBBORN.values(), ids=STUBBORN)
def test_code_that_resists_its_time_limit_is_ended(
    folder: Callable[..., Path], code: str, reason: str
) -> None:
    with pytest.raises(UserError, match=reason):
        asked(folder, code, limits=BRIEF)


def test_a_sleep_ends_the_process(folder: Callable[..., Path]) -> None:
    with pytest.raises(UserError, match='within 1 s: does the code sleep'):
        asked(folder, 'import time; time.sleep(1000)', limits=ProcessLimits(wait=1.0))


def test_sleeping_in_each_call_ends_the_submission(folder: Callable[..., Path]) -> None:
    sleepy = BIKE_FE.replace(':', ':\n    import time; time.sleep(0.3)')
    path = folder(bike_model=sleepy)
    calls = 0
    with JudgedCode(path, ProcessLimits(total=1.0)) as code, suppress(UserError):
        while calls < 100:
            code.rows('bikeFE', [ROW])
            calls += 1
    with pytest.raises(UserError, match=r'used up its total of 1 s'):
        code.rows('bikeFE', [ROW])

    assert calls <= 3


def test_each_of_a_few_slow_calls_has_its_own_time(folder: Callable[..., Path]) -> None:
    busy = 'from time import process_time as t\n    end = t() + 0.1\n    while t() < end: pass'
    path = folder(bike_model=BIKE_FE.replace(':', f':\n    {busy}'))
    with JudgedCode(path, QUICK) as code:
        assert len(code.rows('bikeFE', [ROW] * 5)) == 5


def test_confined_code_can_use_python_and_numpy(folder: Callable[..., Path]) -> None:
    code = '\n'.join(ALLOWED.values())
    # A busy machine, which has none of the modules compiled, takes long.
    patient = ProcessLimits(call=60.0, wait=100.0)
    assert asked(folder, code, limits=patient) == [(1.0, 2.0, 3.0, 4.0)]


@pytest.mark.parametrize('abi', [1, 3])
def test_confined_code_is_refused_the_same_on_older_kernels(
    folder: Callable[..., Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, abi: int
) -> None:
    real = process.abi()
    monkeypatch.setattr(process, 'abi', lambda: min(abi, real))
    attempts = [
        code
        for name, (code, _) in REFUSED.items()
        if not name.startswith(('import', 'eat', 'leave', 'recurse', 'start a thread'))
    ]
    attempts += [f"os.open('helper.py', {flags} | os.O_TRUNC)" for flags in (0, 1, 2, 3)]
    attempts += ["os.truncate('helper.py', 0)", "os.rename('helper.py', 'own.py')"]
    attempts += ["os.link('helper.py', '../own.py')", "os.open('.', os.O_RDWR | os.O_TMPFILE)"]
    code = '\n'.join(
        f'try:\n    {attempt}\nexcept (OSError, ValueError):\n    pass\n'
        f'else:\n    raise AssertionError({attempt!r})'
        for attempt in attempts
    )

    assert asked(folder, code, limits=ProcessLimits()) == [(1.0, 2.0, 3.0, 4.0)]
    assert (tmp_path / 'student' / 'helper.py').read_text() == 'ANSWER = 42'


def test_sets_have_the_same_order_in_each_process(folder: Callable[..., Path]) -> None:
    text = BIKE_FE.replace('[1.0', '[hash("speed") % 1e6')
    path = folder(bike_model=text)
    answers = set()
    for _ in range(2):
        with JudgedCode(path) as confined:
            answers |= {*confined.rows('bikeFE', [ROW])}

    assert len(answers) == 1


def test_a_closed_process_leaves_no_descriptor_open(folder: Callable[..., Path]) -> None:
    path = folder(bike_model=BIKE_FE)
    before = [*Path('/proc/self/fd').iterdir()]

    with JudgedCode(path) as confined:
        confined.rows('bikeFE', [ROW])

    assert len([*Path('/proc/self/fd').iterdir()]) == len(before)


def test_unconfined_only_the_limits_hold(folder: Callable[..., Path]) -> None:
    path = folder(bike_model=f'open("/etc/passwd")\n{BIKE_FE}')
    with JudgedCode(path, ProcessLimits(confined=False)) as confined:
        assert confined.rows('bikeFE', [ROW]) == [(1.0, 2.0, 3.0, 4.0)]


def test_a_kernel_without_landlock_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    # A number that no kernel gives to a system call.
    monkeypatch.setattr('barc_sim.lab.confined.child._CREATE_RULESET', 100_000)

    with pytest.raises(UserError, match=r'no Landlock here.*--unconfined'):
        check_confinement(ProcessLimits())
    check_confinement(ProcessLimits(confined=False))


# The filter of system calls, run here in an interpreter of its few instructions.
PASSED, KILLED, ERRNO = 0x7FFF0000, 0x80000000, 0x00050000
DENIED = ERRNO | EPERM
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
    instructions: list[tuple[int, int, int, int]] = [*iter_unpack('=HBBI', call_filter(machine))]
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
    for names, answer in ((HARMLESS, PASSED), (HARMFUL, DENIED)):
        answers = {decide(machine, number) for number in call_numbers(machine, names).values()}
        assert answers == {answer}
    assert decide(machine, 4_000) == DENIED  # of a later kernel
    read, ioctl = call_numbers(machine, ('read', 'ioctl')).values()
    assert decide(machine, read, audit=0x40000003) == KILLED  # of another architecture
    assert decide(machine, ioctl, 0, 0x5401) == ERRNO | ENOTTY


@pytest.mark.parametrize('call', [57, 58, 76, 87, 90, 0x40000000])
def test_old_calls_of_x86_64_are_refused(call: int) -> None:
    """Fork, vfork, truncate, unlink and chmod, which the other architecture lacks; and x32."""
    assert decide('x86_64', call) == DENIED


@pytest.mark.parametrize(
    ('machine', 'call', 'at'),
    [('x86_64', 'open', 1), ('x86_64', 'openat', 2), ('aarch64', 'openat', 2)],
)
def test_a_file_is_not_emptied_by_opening_it(machine: str, call: str, at: int) -> None:
    """Of writing, Landlock decides."""
    (number,) = call_numbers(machine, [call]).values()
    answers = [decide(machine, number, *[0] * at, flags) for flags in (*READS, *EMPTIES)]
    assert answers == [PASSED] * len(READS) + [DENIED] * len(EMPTIES)


_RANDOM = Random(6)  # noqa: S311 (a simulation)
SAMPLES = [(8.0, _RANDOM.uniform(0.0, 9.0), 0.02) for _ in range(500)]
#: It loops at 5 m/s, and ends its process at 6 m/s.
PID_THAT_HANGS = user_text('pid_that_hangs.py')


def test_a_controller_gives_the_same_as_in_this_process(folder: Callable[..., Path]) -> None:
    here = PID(3.0, 2.0, 0.1)
    with JudgedCode(folder(controller=CONTROLLER)) as code:
        expected = [here.acc_calculate(*sample) for sample in SAMPLES]
        assert code.steps('PID', code.make('PID', 3.0, 2.0, 0.1), SAMPLES) == expected


def test_an_infinity_that_is_forged_is_refused(folder: Callable[..., Path]) -> None:
    text = user_text('attack_forge.py')
    with (
        JudgedCode(folder(bike_model=text), QUICK) as code,
        pytest.raises(UserError, match='bikeFE returned something other than finite numbers'),
    ):
        code.rows('bikeFE', [ROW])


def test_a_call_after_one_that_ended_the_process_is_answered(folder: Callable[..., Path]) -> None:
    with JudgedCode(folder(controller=PID_THAT_HANGS), QUICK) as code:
        stuck = code.make('PID', 1.0, 1.0, 1.0)
        with pytest.raises(UserError, match=r'line 6: acc_calculate.* not return within 0.3 s'):
            code.steps('PID', stuck, [(8.0, 5.0, 0.02)])
        with pytest.raises(UserError, match=r'crashed'):
            code.steps('PID', stuck, [(8.0, 6.0, 0.02)])

        with pytest.raises(UserError, match='the process of this object has ended'):
            code.steps('PID', stuck, [(8.0, 4.0, 0.02)])
        assert code.steps('PID', code.make('PID', 1.0, 1.0, 1.0), [(8.0, 4.0, 0.02)]) == [1.0]


def test_an_endless_loop_in_a_file_takes_its_time_once(folder: Callable[..., Path]) -> None:
    path = folder(lane='while True:\n    pass\n')
    with JudgedCode(path, ProcessLimits(call=0.5)) as code:
        before = os.times().children_user
        for name in ('straight_errors', 'arc_errors', 'steady') * 3:
            with pytest.raises(UserError, match=r'loading the file took longer than 0.5 s'):
                code.rows(name, [[0.0] * 6])
    assert os.times().children_user - before < 2.0


def test_a_function_that_keeps_ending_its_process_is_not_called_again(
    folder: Callable[..., Path],
) -> None:
    text = 'import os\nprint("called")\nos._exit(3)\n'
    with JudgedCode(folder(bike_model=text, controller=CONTROLLER)) as code:
        for _ in range(5):
            with pytest.raises(UserError, match='ended itself with exit code 3'):
                code.rows('bikeFE', [ROW])

        assert code.printed.count('called') == 3
        assert code.steps('PID', code.make('PID', 1.0, 0.0, 0.0), [(8.0, 7.0, 0.02)]) == [1.0]


@pytest.mark.parametrize(
    'forged',
    [
        "notes = lambda self: {'gains': [1, 2, 3, 'x' * 10**6], 'tolerated': ['y' * 10**6] * 10}",
        'notes = lambda self: 10**4000',
        'relay_commands = lambda self, *_: [[0.1, 0.2, 0.3]] * 10**5',
        "relay_commands = lambda self, *_: [[0, 'x', None]]",
        "relay_commands = lambda self, *_: {'x': 1}",
        'relay_commands = lambda self, *_: [[10**400, 0.0, 0.0]]',
        "relay_commands = lambda self, *_: eval('[' * 50 + ']' * 50)",
        "notes = lambda self: {'gains': [10**400, 1.0, 1.0, ''], 'tolerated': []}",
        "notes = lambda self: {'gains': [1.0, 1.0, 1.0, '\\ud800'], 'tolerated': ['\\ud800']}",
    ],
)
def test_forged_answers_of_any_shape_and_size_are_sentences(
    folder: Callable[..., Path], forged: str
) -> None:
    patch = f"import sys\nsys.modules['barc_sim.lab.user_code.code'].UserCode.{forged}\n"
    text = f'{patch}def relay(x, z): return [x, z]\n'
    with JudgedCode(folder(relay=text, bike_model=patch + MODEL)) as code:
        code.rows('bikeFE', [[0.1] * 11])
        if 'relay' in forged:
            with pytest.raises(UserError, match='relay'):
                relay_commands(code, [], 1.0)

        assert len(str(code.chosen_gains())) < 500
        assert sum(map(len, code.tolerated())) < 10_000


def test_the_first_request_of_a_process_finds_a_line(folder: Callable[..., Path]) -> None:
    with JudgedCode(folder(bike_model=BIKE_FE)) as code:
        assert code.line_of('functions', ('bikeFE', [ROW]), [3.0], []) == 'bike_model.py, line 3'


def test_a_forged_list_of_lines_is_not_read(folder: Callable[..., Path]) -> None:
    text = f"""
import sys
code = sys.modules['barc_sim.lab.user_code.code'].UserCode
code.lines = lambda *_: [['a', 1.0]] * 1_000_000
{BIKE_FE}
"""
    with JudgedCode(folder(bike_model=text)) as code:
        code.rows('bikeFE', [ROW])
        assert not code.line_of('functions', ('bikeFE', [ROW]), [3.0], [])


def test_a_name_that_no_file_can_hold_is_graded(folder: Callable[..., Path]) -> None:
    text = "NAME = '\\ud800' * 1000\ndef command(t):\n    return 1.0\n"
    graded = grade(read_submission(folder(identify=text)), load_rubric('identify'), ProcessLimits())
    points = graded.points
    assert points['commands.limits'] > 0.0
    gradescope(graded).encode()
