"""What a submission's process can't do, each tried from within."""

from __future__ import annotations

import re
import sys
import time
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

import barc_sim
from barc_sim.errors import UserError
from barc_sim.lab.confined import kernel
from barc_sim.lab.confined.process import Limits, check
from barc_sim.lab.hills.code import HillsCode

if TYPE_CHECKING:
    from collections.abc import Callable

pytestmark = pytest.mark.usefixtures('confinement')

ROW = [0.0] * 11
QUICK = Limits(call=0.3, wait=8.0)
BIKE_FE = """
def bikeFE(x, y, psi, v, a, d_f, a0, m, Ff, theta, ts):
    return [1.0, 2.0, 3.0, 4.0]
"""
_TO_ALL = 'for i in range(3, 64):\n try: os.write(i, {})\n except OSError: pass'
#: Each is refused with an exception, which names the reason.
REFUSED = {
    'write into its own folder': ("open('results.json', 'w')", 'Permission denied'),
    'write elsewhere': ("open('/tmp/results.json', 'w')", 'Permission denied'),
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
    'close all files': ('os.closerange(0, 100)', 'not its own'),
    'write to all files': (_TO_ALL.format('bytes(range(1, 100))'), 'not its own'),
    'forge an answer and stall': (
        _TO_ALL.format('b\'{"serial": 1, "result": [[1.0,\'') + '\nwhile True: pass',
        'not its own',
    ),
    'catch everything, and loop': (
        'while True:\n try:\n  while True: pass\n except BaseException: pass',
        'longer than 0.3 s|within 0.3 s',
    ),
    'ignore the alarm': (
        'import signal; signal.signal(signal.SIGPROF, signal.SIG_IGN)\nwhile True: pass',
        'did not answer within 0.3 s of processor time; is there an endless',
    ),
}
#: None is anybody's harm.
ALLOWED = {
    'use NumPy': 'import numpy as np; assert np.linalg.det(np.eye(100)) == 1.0',
    'use the standard library': 'import decimal, hashlib, json, random, sqlite3, ssl, statistics',
    'read its own files': "assert 'bikeFE' in open('bike_model.py').read()",
    'import its own modules': 'import helper; assert helper.ANSWER == 42',
    'write to nowhere': "print('hello', file=open(os.devnull, 'w'))",
    'close its output': 'os.close(1); os.close(2)',
    'have nothing in its environment': "assert not {'HOME', 'PATH'} & {*os.environ}",
}


def asked(
    folder: Callable[..., Path], code: str, *, limits: Limits = QUICK
) -> list[tuple[float, ...]]:
    path = folder(bike_model=f'import os\n{code}\n{BIKE_FE}', helper='ANSWER = 42')
    folder('neighbour', bike_model=BIKE_FE)
    with HillsCode(path, limits) as confined:
        return [*confined.bike_fe([ROW])]


def test_it_cannot(folder: Callable[..., Path]) -> None:
    folder('neighbour', bike_model=BIKE_FE)
    attempts = ''.join(
        f'try:\n    {code}\n    print("done")\n'
        'except BaseException as error:\n    print(type(error).__name__, error)\n'
        for code, _ in REFUSED.values()
    )
    with HillsCode(
        folder(bike_model=f'import os\n{attempts}\n{BIKE_FE}'), Limits(memory=1 << 28)
    ) as code:
        code.bike_fe([ROW])
    for name, (_, reason), line in zip(
        REFUSED, REFUSED.values(), code.printed.splitlines(), strict=True
    ):
        assert re.search(reason, line), f'{name}: {line}'


@pytest.mark.parametrize(('code', 'reason'), FATAL.values(), ids=FATAL)
def test_it_harms_only_itself_where_it_tries_to(
    folder: Callable[..., Path], code: str, reason: str
) -> None:
    with pytest.raises(UserError, match=reason):
        asked(folder, code)


def test_a_sleep_ends_the_process(folder: Callable[..., Path]) -> None:
    with pytest.raises(UserError, match='within 1 s; does it sleep'):
        asked(folder, 'import time; time.sleep(1000)', limits=Limits(wait=1.0))


def test_sleeping_in_each_call_ends_the_submission(folder: Callable[..., Path]) -> None:
    sleepy = BIKE_FE.replace(':', ':\n    import time; time.sleep(0.3)')
    path = folder(bike_model=sleepy)
    began = time.monotonic()
    with HillsCode(path, Limits(total=1.0)) as code, suppress(UserError):
        for _ in range(100):
            code.bike_fe([ROW])
    with pytest.raises(UserError, match=r'used up the 1 s that it has'):
        code.bike_fe([ROW])

    assert time.monotonic() - began < 10.0


def test_it_may(folder: Callable[..., Path]) -> None:
    code = '\n'.join(ALLOWED.values())
    assert asked(folder, code, limits=Limits()) == [(1.0, 2.0, 3.0, 4.0)]


def test_it_is_ended_when_its_processor_time_is_used_up(folder: Callable[..., Path]) -> None:
    with pytest.raises(UserError, match='used up 1 s of processor time'):
        asked(folder, 'while True: pass', limits=Limits(cpu=1, call=60.0, wait=60.0))


@pytest.mark.parametrize('abi', [1, 3])
def test_it_cannot_on_older_kernels_either(
    folder: Callable[..., Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, abi: int
) -> None:
    real = kernel.abi()
    monkeypatch.setattr(kernel, 'abi', lambda: min(abi, real))
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

    assert asked(folder, code, limits=Limits()) == [(1.0, 2.0, 3.0, 4.0)]
    assert (tmp_path / 'student' / 'helper.py').read_text() == 'ANSWER = 42'


def test_it_sees_the_same_order_of_sets_each_time(folder: Callable[..., Path]) -> None:
    text = BIKE_FE.replace('[1.0', '[hash("speed") % 1e6')
    path = folder(bike_model=text)
    answers = set()
    for _ in range(2):
        with HillsCode(path) as confined:
            answers |= {*confined.bike_fe([ROW])}

    assert len(answers) == 1


def test_it_leaves_no_descriptor_open(folder: Callable[..., Path]) -> None:
    path = folder(bike_model=BIKE_FE)
    before = [*Path('/proc/self/fd').iterdir()]

    with HillsCode(path) as confined:
        confined.bike_fe([ROW])

    assert len([*Path('/proc/self/fd').iterdir()]) == len(before)


def test_without_the_sandbox_only_the_limits_hold(folder: Callable[..., Path]) -> None:
    path = folder(bike_model=f'open("/etc/passwd")\n{BIKE_FE}')
    with HillsCode(path, sandbox=False) as confined:
        assert confined.bike_fe([ROW]) == [(1.0, 2.0, 3.0, 4.0)]


def test_a_kernel_without_landlock_is_told_of(monkeypatch: pytest.MonkeyPatch) -> None:
    # A number that no kernel gives to a system call.
    monkeypatch.setattr('barc_sim.lab.confined.kernel._CREATE_RULESET', 100_000)

    with pytest.raises(UserError, match=r'no Landlock here.*--unconfined'):
        check(sandbox=True)
    check(sandbox=False)
