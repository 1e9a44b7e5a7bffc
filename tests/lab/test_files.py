"""A user's file before it runs: its errors, and the gains that it chooses."""

from __future__ import annotations

import ast
from inspect import signature
from typing import TYPE_CHECKING, Any

import pytest

from barc_sim.errors import UserError
from barc_sim.lab.files import UserCodeError, compiled, find_gains, read_source, united

if TYPE_CHECKING:
    from pathlib import Path

    from barc_sim.lab.files import Source


def source(tmp_path: Path, data: bytes) -> Source:
    path = tmp_path / 'controller.py'
    path.write_bytes(data)
    return read_source(path, 'controller.py')


@pytest.mark.parametrize(
    ('text', 'sentence'),
    [
        ('def f(x)\n    return x', "line 1: syntax error: expected ':': def f(x)"),
        ('try:\n    x\nexcept A, e:\n    x', 'line 3: syntax error: '),
        ('(' * 100_000, 'line 1: syntax error: '),
    ],
)
def test_a_syntax_error_names_the_line_and_the_fix(
    tmp_path: Path, text: str, sentence: str
) -> None:
    with pytest.raises(UserCodeError) as caught:
        compiled(source(tmp_path, text.encode()))
    assert f'controller.py, {sentence}' in str(caught.value)
    assert len(str(caught.value)) < 300


#: Lines with a print statement of Python 2, and what they print.
PRINTS = {
    "print 'hi', 1": 'hi 1\n',
    "print 'hi'  # a comment, and (": 'hi\n',
    "if 1: print 'a'; print 'b; #', 'c'": 'a\nb; # c\n',
    "print 'a',\nprint 'b'": 'a b\n',
    "print 'a %d' % (\n    5\n)\nprint 'b'": 'a 5\nb\n',
    "for i in range(2):\n\tprint i\n        print 'x'": '0\nx\n1\nx\n',
    'def f():\n    print u"é", """a\nb"""\nf()': 'é a\nb\n',
}


@pytest.mark.parametrize('text', PRINTS)
def test_a_print_statement_of_python_2_prints(
    tmp_path: Path, text: str, capsys: pytest.CaptureFixture[str]
) -> None:
    result = compiled(source(tmp_path, text.encode()))
    exec(result.code, {})  # noqa: S102
    assert capsys.readouterr().out == PRINTS[text]
    assert 'print is a function in Python 3: write print(' in '; '.join(result.tolerated)


def test_lines_keep_their_numbers_after_a_print_statement(tmp_path: Path) -> None:
    text = "print 'a %d' % (\n    5\n)\nx = 1 / 0\n"
    with pytest.raises(ZeroDivisionError) as caught:
        exec(compiled(source(tmp_path, text.encode())).code, {})  # noqa: S102
    last = caught.tb.tb_next
    assert last
    assert last.tb_lineno == 4


def test_many_print_statements_are_a_syntax_error(tmp_path: Path) -> None:
    text = "print 'a'\n" * 1000
    with pytest.raises(UserCodeError, match='line 201: syntax error: Missing parentheses'):
        compiled(source(tmp_path, text.encode()))


def test_tabs_are_as_wide_as_in_python_2(tmp_path: Path) -> None:
    result = compiled(source(tmp_path, b'if 0:\n        x = 1\n\tx = 2\ny = "\t"\n'))
    module: dict[str, object] = {}
    exec(result.code, module)  # noqa: S102
    assert 'x' not in module
    assert module['y'] == '\t'
    assert result.tolerated == ('tabs and spaces are mixed: a tab counts as 8 spaces',)


@pytest.mark.parametrize('data', [b'\xff\xfex\0', 'x = 1\n# °'.encode('latin-1')])
def test_another_encoding_is_refused(tmp_path: Path, data: bytes) -> None:
    with pytest.raises(UserCodeError, match=r'line [12]: the byte 0x(ff|b0) is not UTF-8: save'):
        source(tmp_path, data)


def test_a_byte_order_mark_of_windows_is_ignored(tmp_path: Path) -> None:
    module: dict[str, object] = {}
    exec(compiled(source(tmp_path, b'\xef\xbb\xbfx = 1\r\n')).code, module)  # noqa: S102
    assert module['x'] == 1


def test_a_file_of_no_sensible_size_is_refused(tmp_path: Path) -> None:
    with pytest.raises(UserError, match='more than 1000000 bytes'):
        source(tmp_path, b'#' * 1_000_001)


PID = 'class PID:\n    def __init__(self, kp=1, ki=1, kd=1): pass\n'
PLAIN = 'class PID:\n    def __init__(self, kp, ki, kd): pass\n'


@pytest.mark.parametrize(
    ('text', 'expected'),
    [
        (PLAIN, None),
        (PID, None),
        (PID + 'def main():\n    c = PID(10, 0.5, 0.4)\n', (10, 0.5, 0.4, 'line 4')),
        (PID + 'def main():\n    c = PID(kd=-.4, kp=10, ki=1/2)\n', (10, 0.5, -0.4, 'line 4')),
        (PID + 'PID(1, 1, 1)\n', (1, 1, 1, 'line 3')),
        (PID + 'PID(1, 2, 3)\n# PID(4, 5, 6)\nPID(7, 8, 9)\n', (7, 8, 9, 'line 5')),
        (PID + 'PID(kp=5)\n', (5, 1, 1, 'line 3')),
        (PLAIN + 'PID(5)\nPID()\n', None),
        (
            'KP, KI = 3, 4\nKD = KP * 2\n' + PLAIN + 'PID(KP, KI, KD)\n',
            (3, 4, 6, 'line 5'),
        ),
        (PLAIN + 'def main():\n    a = 3\n    PID(a, a, 0)\n', (3, 3, 0, 'line 5')),
        ('K = 3\n' + PLAIN + 'PID(1, 2, 3)\nPID(K, K, K)\n', (3, 3, 3, 'line 5')),
        (PLAIN + 'PID(input(), 1, 2)\n', None),
        (PID.replace('kp=1', 'kp=4'), (4, 1, 1, 'defaults')),
        (
            'class PID:\n    def __init__(self, P=2, I=0, D=1, max=5): pass\n',
            (2, 0, 1, 'defaults'),
        ),
        (
            'class PID:\n    def __init__(self, kp, kd, ki): pass\nPID(1, 2, 3)\n',
            (1, 3, 2, 'line 3'),
        ),
        (PLAIN + 'PID(*[1, 2, 3])\n', (1, 2, 3, 'line 3')),
        ('G = {"kp": 2, "ki": 3, "kd": 0}\n' + PLAIN + 'PID(**G)\n', (2, 3, 0, 'line 4')),
        (PLAIN + 'PID(**dict(kp=2, ki=3, kd=float(0)))\n', (2, 3, 0, 'line 3')),
        (PLAIN + 'def f(self):\n  self.k = 4\n  self.pid = PID(self.k, 1, 0)', (4, 1, 0, 'line 5')),
        (PLAIN + 'PID(1e400, 1, 1)\n', None),
    ],
)
def test_gains_come_from_calls_constants_and_defaults_in_this_order(
    text: str, expected: tuple[float, float, float, str] | None
) -> None:
    tree = ast.parse(text)
    names: dict[str, Any] = {}
    (kind,) = (node for node in tree.body if isinstance(node, ast.ClassDef))
    exec(compile(ast.Module([kind], []), 'controller.py', 'exec'), names)  # noqa: S102

    gains = find_gains(tree, 'controller.py', signature(names['PID']), 'line 2')

    if expected and expected[3] == 'defaults':
        assert gains == (*expected[:3], 'defaults, line 2')
    elif expected:
        assert gains == (*expected[:3], f'controller.py, {expected[3]}')
    else:
        assert gains is None


def test_a_name_of_two_labs_is_refused() -> None:
    assert united([{'line': 1}, {'profile': 2}]) == {'line': 1, 'profile': 2}
    with pytest.raises(ValueError, match="'line' is in two labs"):
        united([{'line': 1}, {'line': 2}])
