"""Loading a user's files, and calling what they define."""

from __future__ import annotations

import math
import os
from typing import TYPE_CHECKING

import pytest
from user_files import load, load_folder, user_text

from barc_sim.errors import UserError
from barc_sim.lab.confined.process import JudgedCode, ProcessLimits
from barc_sim.lab.files import FILES, UserCodeError
from barc_sim.lab.user_code.code import UserCode

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from barc_sim.lab.user_code.code import UserObject
    from barc_sim.lab.user_code.folder import UserFunction

#: A request for each part.
CALLS = {
    'model': ('functions', 'bikeFE', []),
    'controller': ('make', 'PID', 1, 1.0, 1.0, 1.0),
    'relay': ('relay_commands', [], 1.0, []),
}
ROW = (1.0, 2.0, 0.5, 8.0, 0.25, 0.1, 0.013, 2000.0, 0.017, 0.1, 0.02)
CALLED = (
    'bikeFE(x=1.0, y=2.0, psi=0.5, v=8.0, a=0.25, d_f=0.1, a0=0.013, m=2000.0, Ff=0.017, '
    'theta=0.1, ts=0.02)'
)
FOUR = 'expected four finite numbers, [x_next, y_next, psi_next, v_next]'
ROW_NAMES = 'x, y, psi, v, a, d_f, a0, m, Ff, theta, ts'
HEAD = f'def bikeFE({ROW_NAMES}):\n'
SHORT = 0.2


def lab(tmp_path: Path, **files: str) -> Path:
    for name, text in files.items():
        (tmp_path / f'{name}.py').write_text(text)
    return tmp_path


def model(tmp_path: Path, body: str, before: str = '') -> UserFunction:
    path = lab(tmp_path, bike_model=f'{before}{HEAD}    {body}\n') / 'bike_model.py'
    function = load(path, budget=SHORT).model
    assert function
    return function


@pytest.mark.parametrize(
    'body',
    [
        'return [x, y, psi, v]',
        'return x, y, psi, v',
        'import numpy as np; return np.array([x, y, psi, v])',
        'import numpy as np; return np.array([[x], [y], [psi], [v]])',
        'import numpy as np; return [np.float64(x), np.array([y]), np.array(psi), v]',
        'import math; return [math.fabs(x), int(y), psi, v]',
        'return map(float, (x, y, psi, v))',
        'return dict(x=x, y=y, psi=psi, v=v).values()',
        'import itertools; return (e for e in (x, y, psi, v))',
    ],
)
def test_four_numbers_of_any_kind_become_floats(tmp_path: Path, body: str) -> None:
    result = model(tmp_path, body)(*ROW)
    assert result == [1.0, 2.0, 0.5, 8.0]
    assert [type(value) for value in result] == [float] * 4


@pytest.mark.parametrize(
    ('body', 'result'),
    [
        ('pass', 'None; ' + FOUR + ': is its return missing?'),
        ('return [x, y, psi]', '[1.0, 2.0, 0.5]; ' + FOUR),
        ('return [x, y, psi, float("nan")]', '[1.0, 2.0, 0.5, nan]; ' + FOUR),
        ('return {x, x + 1, x + 2, x + 3}', '{1.0, 2.0, 3.0, 4.0}; ' + FOUR),
        ('return [x, y, psi, "8"]', "[1.0, 2.0, 0.5, '8']; " + FOUR),
        ('return [x, y, psi, 1j]', '[1.0, 2.0, 0.5, 1j]; ' + FOUR),
        ('return list(range(10 ** 4))', '[0, 1, 2, 3, 4, 5, ...]; ' + FOUR),
    ],
)
def test_another_result_is_shown_beside_what_was_passed_in_and_expected(
    tmp_path: Path, body: str, result: str
) -> None:
    with pytest.raises(UserCodeError) as caught:
        model(tmp_path, body)(*ROW)
    sentence = str(caught.value)
    assert sentence.startswith(f'bike_model.py, line 1: {CALLED} returned ')
    assert sentence.endswith(f' returned {result}')


@pytest.mark.parametrize(
    ('body', 'text'),
    [
        ('return [x / (y - y), 0, 0, 0]', 'ZeroDivisionError: float division by zero'),
        ('return foo', "NameError: name 'foo' is not defined"),
        ('raise ValueError', 'ValueError'),
        ('raise NameError', 'NameError'),
        ('self = type("S", (), {"__dict__": 3})(); return foo', 'NameError: name '),
        ('exit()', 'SystemExit'),
        ('input()', 'EOFError: input() does not work here'),
        ('return bikeFE(*[0] * 11)', 'RecursionError: '),
    ],
)
def test_an_exception_names_its_line_and_what_was_passed_in(
    tmp_path: Path, body: str, text: str
) -> None:
    with pytest.raises(UserCodeError) as caught:
        model(tmp_path, body)(*ROW)
    sentence = str(caught.value)
    assert sentence.startswith(f'bike_model.py, line 2: {CALLED} raised {text}')
    assert sentence.endswith(f'; {FOUR}')
    assert caught.value.__cause__ is not None


@pytest.mark.parametrize(
    ('arguments', 'returned', 'result'),
    [
        (f'{ROW_NAMES}, g=1, l_r=2', '[g, l_r, 0, 0]', [9.5, 1.25, 0.0, 0.0]),
        (f'{ROW_NAMES}, gain=3.0', '[gain, 0, 0, 0]', [3.0, 0.0, 0.0, 0.0]),
        ('*row, **options', '[*options.values(), row[0]]', [1.5, 1.25, 9.5, 1.0]),
    ],
)
def test_the_geometry_is_passed_where_it_is_an_argument(
    tmp_path: Path, arguments: str, returned: str, result: list[float]
) -> None:
    text = f'def bikeFE({arguments}):\n    return {returned}\n'
    f = load(lab(tmp_path, bike_model=text) / 'bike_model.py').model
    assert f
    assert f(*ROW, l_f=1.5, l_r=1.25, g=9.5) == result


@pytest.mark.parametrize(
    ('part', 'text', 'sentence'),
    [
        ('bike_model', 'x = 1', 'bike_model.py defines no bikeFE'),
        ('bike_model', 'bikeFE = 3', 'bike_model.py: bikeFE is 3; expected a function'),
        (
            'bike_model',
            '\ndef bikeFE(x, y): pass',
            f'line 2: bikeFE takes (x, y); expected ({ROW_NAMES})',
        ),
        ('bike_model', 'x = (', "bike_model.py, line 1: syntax error: '(' was never closed: x = ("),
        ('bike_model', 'from nowhere import *', "line 1: there is no module 'nowhere'"),
        ('bike_model', '\n1 / 0', 'line 2: loading the file raised ZeroDivisionError: '),
        ('bike_model', '\0', ': source code string cannot contain null bytes'),
        ('controller', 'class PD: pass', 'controller.py defines no PID'),
        ('controller', 'class PID: pass', 'controller.py: PID takes (); expected (kp, ki, kd)'),
        (
            'controller',
            'class PID:\n    def __init__(self, kp, ki, kd): pass',
            'the class PID has no method acc_calculate(self, speed_reference, speed_current)',
        ),
        ('relay', 'x = 1', 'relay.py defines no relay nor Relay'),
        ('relay', 'def relay(x): pass', 'relay takes (x); expected (linear_x, angular_z)'),
        ('relay', 'class Relay: pass', 'Relay has no method relay(self, linear_x, angular_z)'),
    ],
)
def test_a_file_that_cannot_be_used_is_refused_in_one_sentence(
    tmp_path: Path, part: str, text: str, sentence: str
) -> None:
    with pytest.raises(UserCodeError) as caught:
        load(lab(tmp_path, **{part: text}) / f'{part}.py')
    assert sentence in str(caught.value)
    assert '\n' not in str(caught.value)


@pytest.mark.skipif(not hasattr(os, 'mkfifo'), reason='a system without named pipes')
@pytest.mark.parametrize('part', CALLS)
def test_a_named_pipe_is_refused_in_one_sentence(tmp_path: Path, part: str) -> None:
    os.mkfifo(tmp_path / FILES[part])
    with pytest.raises(UserError, match=r"^'[^:]*' is a named pipe, where"):
        load_folder(tmp_path, [part])
    with (
        JudgedCode(tmp_path, ProcessLimits(confined=False)) as code,
        pytest.raises(UserError, match='named pipe'),
    ):
        code.call(*CALLS[part])


def test_a_loop_without_end_outside_of_functions_is_ended(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr('barc_sim.lab.user_code.code._LOADING', SHORT)
    with pytest.raises(UserCodeError, match=r'line 2: loading the file took longer than 0.2 s'):
        load(lab(tmp_path, bike_model='x = 1\nwhile True: x += 1\n') / 'bike_model.py')


PID = user_text('pid_with_calls.py')


def controller(tmp_path: Path, text: str) -> Callable[..., UserObject]:
    return load(lab(tmp_path, controller=text) / 'controller.py', budget=SHORT).new_pid


@pytest.mark.parametrize('dt', ['dt', 'dt=None', '*, dt', 'gain=2, dt=None'])
def test_a_controller_that_takes_dt_gets_dt(tmp_path: Path, dt: str) -> None:
    text = PID.replace('speed_current):', f'speed_current, {dt}):')
    text = text.replace('return self.proportional', 'return dt  #')
    assert controller(tmp_path, text)(1.0, 1.0, 1.0).acc_calculate(8.0, 7.0, 0.02) == 0.02


def test_gains_and_terms_are_those_of_the_object(tmp_path: Path) -> None:
    pid = controller(tmp_path, PID)(1.0, 2.0, 3.0)
    assert math.isnan(pid.read('proportional'))
    pid.set_gains({'kp': 5.0, 'ki': 6.0, 'kd': 7.0})
    pid.acc_calculate(8.0, 7.0, 0.02)
    assert [pid.read(name) for name in ('kp', 'ki', 'kd', 'proportional')] == [5.0, 6.0, 7.0, 5.0]
    assert math.isnan(pid.read('integral'))


@pytest.mark.parametrize('first', ['kd, ki, kp', 'dt=0.02, kp=1.0, ki=1.0, kd=1.0'])
def test_gains_come_by_their_names(tmp_path: Path, first: str) -> None:
    pid = controller(tmp_path, PID.replace('kp, ki, kd, scale', f'{first}, scale', 1))(
        5.0, 6.0, 7.0
    )
    assert [pid.read(name) for name in ('kp', 'ki', 'kd')] == [5.0, 6.0, 7.0]


def test_gains_that_cannot_be_set_stay(tmp_path: Path) -> None:
    fixed = '    kp = property(lambda self: 4.0)\n    ki = property(lambda self: 1 / 0)\n'
    text = f'{PID}{fixed}'.replace('self.kp, self.ki, self.kd, self.scale = kp, ki, kd, scale', '')
    pid = controller(tmp_path, text)(1.0, 2.0, 3.0)
    pid.set_gains({'kp': 5.0, 'ki': 6.0, 'kd': 7.0})
    assert pid.read('kp') == 4.0
    assert math.isnan(pid.read('ki'))


def test_a_long_list_is_shown_by_its_first_items(tmp_path: Path) -> None:
    code = lab(tmp_path, identify='def command(t): pass\ndef estimate(t, v, a): 1 / 0\n')
    function = UserCode({'identify': code / 'identify.py'}).function('estimate')
    with pytest.raises(
        UserCodeError, match=r'estimate\(t=\[0, 1, 2, 3, 4, 5, \.{3}\], v=\[\], a=\[\]\) '
    ):
        function([*range(3000)], [], [])


def test_files_of_two_folders_make_one_lab(tmp_path: Path) -> None:
    (tmp_path / 'a').mkdir()
    (tmp_path / 'b').mkdir()
    first = lab(
        tmp_path / 'a',
        bike_model=f'from h import f\n{HEAD}    return f()\n',
        h='f = lambda: [1] * 4',
    )
    two = lab(
        tmp_path / 'b',
        relay='from h import f\ndef relay(x, z): return f()\n',
        h='f = lambda: [2] * 2',
    )
    code = UserCode({'model': first / 'bike_model.py', 'relay': two / 'relay.py'}).load()
    assert code.model

    assert code.model(*ROW) == [1.0] * 4
    assert code.new_relay()(0.0, 0.0, dt=0.0) == [2.0, 2.0]
    assert len(code.sources) == 4


def test_printed_text_goes_to_the_given_output(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = lab(
        tmp_path,
        bike_model=f'print("loaded")\n{HEAD}    print(x, y, sep="-", end="")\n    return [0] * 4\n',
    )
    printed: list[str] = []
    code = load_folder(folder, output=printed.append)
    assert code.model
    code.model(*ROW)

    assert printed == ['loaded\n', '1.0-2.0']
    assert capsys.readouterr().out == ''


def test_no_sentence_names_an_address_or_the_folder(tmp_path: Path) -> None:
    with pytest.raises(UserCodeError) as caught:
        model(tmp_path, 'return object()')(*ROW)
    assert ' returned <object object>; ' in str(caught.value)
    with pytest.raises(UserCodeError) as caught:
        model(tmp_path, 'import os; open(os.path.join(os.path.dirname(__file__), "a.txt"))')(*ROW)
    assert str(tmp_path) not in str(caught.value)


#: By name: what is before the model, and what the model returns.
MODELS = {
    'a great number': ('', '[10**5000, y, psi, v]'),
    'no ravel': ('class R(list):\n def ravel(self): raise RuntimeError', 'R([x, y, psi, v])'),
    'no class': ('class R:\n def __getattribute__(self, name): raise RuntimeError', 'R()'),
}


def test_an_error_without_text_is_named(tmp_path: Path) -> None:
    error = 'class E(Exception):\n def __str__(self): return 1 / 0\n'
    with pytest.raises(UserCodeError, match=r'raised E; expected four finite numbers'):
        model(tmp_path, 'raise E', error)(*ROW)


@pytest.mark.parametrize('name', MODELS)
def test_values_that_cannot_be_read_are_a_sentence(tmp_path: Path, name: str) -> None:
    before, returned = MODELS[name]
    with pytest.raises(UserCodeError, match=r'returned .*; expected four finite numbers'):
        model(tmp_path, f'return {returned}', f'{before}\n')(*ROW)
