"""Errors in one line, and exit codes."""

from __future__ import annotations

import os
import subprocess
import sys
from argparse import ArgumentTypeError
from pathlib import Path

import pytest

import barc_sim
from barc_sim.cli.parser import Parser, call, number, whole
from barc_sim.errors import UserError

ROOT = Path(barc_sim.__file__).parents[1]


def raising(error: BaseException) -> int:
    raise error


# The parser


@pytest.mark.parametrize(
    ('arguments', 'message'),
    [
        (['fast'], "argument --speed: invalid float value: 'fast'"),
        (['8', '--hill'], "there is no option '--hill'"),
        (['8', '--spe', '2'], "there is no option '--spe': did you mean --speed?"),
        (['8', '--sped=2'], "there is no option '--sped': did you mean --speed?"),
        (['8', 'up\nhill'], "unexpected argument 'up\\nhill'"),
    ],
)
def test_bad_option_is_one_line_on_stderr_and_exit_code_2(
    arguments: list[str], message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    parser = Parser(prog='drive')
    parser.add_argument('--speed', type=float)
    with pytest.raises(SystemExit) as end:
        parser.parse_args(['--speed', *arguments])
    assert end.value.code == 2
    assert capsys.readouterr() == ('', f'drive: error: {message} (see --help)\n')


# The exit code


def test_user_error_is_one_line_on_stderr_and_exit_code_2(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert call('drive', lambda: raising(UserError('no road\nto drive on'))) == 2
    assert capsys.readouterr() == ('', 'drive: error: no road to drive on\n')


def test_a_link_to_itself_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    loop = tmp_path / 'bag'
    loop.symlink_to(loop)
    assert call('drive', lambda: len(loop.resolve(strict=True).name)) == 2
    assert capsys.readouterr().err.count(str(loop)) == 1


def test_ctrl_c_is_silent_and_exit_code_130(capsys: pytest.CaptureFixture[str]) -> None:
    assert call('drive', lambda: raising(KeyboardInterrupt())) == 130
    assert capsys.readouterr() == ('', '')


@pytest.mark.parametrize(
    ('module', 'name'), [('mcap.writer', 'mcap'), ('PIL', 'pillow'), ('yaml', 'pyyaml')]
)
def test_a_package_that_is_missing_is_named_with_the_line_that_installs_it(
    capsys: pytest.CaptureFixture[str], module: str, name: str
) -> None:
    def main() -> None:
        raise ModuleNotFoundError(f'No module named {module!r}', name=module)

    assert call('barc acc', main) == 2
    error = capsys.readouterr().err
    assert error.count('\n') == 1
    assert f"the package '{module.partition('.')[0]}' is not installed" in error
    assert error.endswith(f'-m pip install {name}\n')


@pytest.mark.parametrize('main', ["lambda: print('a line')", 'Parser().print_help'])
def test_reader_that_went_away_leaves_no_trace_at_exit(main: str) -> None:
    reading, writing = os.pipe()
    os.close(reading)
    script = (
        'import sys; from barc_sim.cli.parser import Parser; from barc_sim.cli.parser import call;'
        f"sys.exit(call('drive', {main}))"
    )
    with os.fdopen(writing, 'w') as stdout:
        process = subprocess.run(
            [sys.executable, '-c', script],
            cwd=ROOT,
            stdout=stdout,
            stderr=subprocess.PIPE,
            check=False,
            timeout=200,
        )

    assert (process.returncode, process.stderr) == (0, b'')


# Types of options


@pytest.mark.parametrize('text', ['-1', '0', '2.5e0', '3'])
def test_number_within_its_bounds_is_taken(text: str) -> None:
    assert number(-1.0, 3.0)(text) == float(text)


@pytest.mark.parametrize('text', ['-1.001', '3.1', 'nan', 'inf', 'three', ''])
def test_other_number_is_refused(text: str) -> None:
    quoted = text if text[-1:].isalnum() and text != 'three' else repr(text)
    with pytest.raises(ArgumentTypeError, match=f'^{quoted} is not a number from -1 to 3'):
        number(-1.0, 3.0)(text)


@pytest.mark.parametrize('text', ['1', '7', '10'])
def test_whole_number_within_its_bounds_is_taken(text: str) -> None:
    assert whole(1, 10)(text) == int(text)


@pytest.mark.parametrize('text', ['0', '11', '1.0', '-1', '', 'one', '9' * 5000])
def test_other_whole_number_is_refused(text: str) -> None:
    with pytest.raises(ArgumentTypeError, match='is not a whole number from 1 to 10'):
        whole(1, 10)(text)


def drive_parser() -> Parser:
    """Return a parser with an option whose help is long."""
    parser = Parser(prog='drive')
    parser.add_argument('--speed', help='the speed that the car holds on its way ' * 3)
    return parser


def test_help_in_a_terminal_without_a_size_is_as_wide_as_usual(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv('COLUMNS', '80')
    usual = drive_parser().format_help()
    monkeypatch.delenv('COLUMNS')
    monkeypatch.setattr(os, 'get_terminal_size', lambda *_: os.terminal_size((0, 0)))
    assert drive_parser().format_help() == usual
