"""F-strings as Python 3.12 reads them: where each ends, on every Python."""

from __future__ import annotations

import ast

import pytest

from barc_sim.lab.f_strings import without_f_strings

F_STRINGS = {
    'plain': 'f"kp {kp}"',
    'single quotes': "f'{kp}'",
    'raw': r'rf"\d{kp}"',
    'capital letters': 'FR"{kp}"',
    'doubled braces': 'f"{{kp}}"',
    'an escaped quote': r'f"\"{kp}\""',
    'its own quotes': 'f"{gains["kp"]}"',
    'a closing brace in quotes': 'f"{gains["}"]}"',
    'brackets in a field': 'f"{[{1: (2,)}[1]]}"',
    'a backslash in a field': r'''f"{'\n'.join(rows)}"''',
    'an escaped quote in a field': r'f"{"\""}"',
    'a format': 'f"{v:{w["a"]}}"',
    'f-strings within': 'f"{f"{f"{1}"}"}"',
    'several lines': 'f"""{\nkp\n}\n"""',
    'a field of several lines': 'f"{kp  # one\n}"',
}


@pytest.mark.parametrize('text', F_STRINGS.values(), ids=F_STRINGS.keys())
def test_an_f_string_becomes_an_empty_text(text: str) -> None:
    continued = '\\\n' * text.count('\n')
    assert without_f_strings(f'a = {text} + b\n') == f"a = ''{continued} + b\n"
    assert without_f_strings(f'a = [{text}, {text}]') == f"a = [''{continued}, ''{continued}]"


@pytest.mark.parametrize('text', F_STRINGS.values(), ids=F_STRINGS.keys())
def test_the_lines_below_keep_their_numbers(text: str) -> None:
    *_, last = ast.parse(without_f_strings(f'a = {text}\nb = 1\n')).body
    assert last.lineno == text.count('\n') + 2


@pytest.mark.parametrize(
    'text',
    [
        'a = "text"',
        'a = r"text"',
        'a = of"text"',
        'a = f(x)',
        '',
    ],
)
def test_a_source_without_f_strings_is_left(text: str) -> None:
    assert without_f_strings(text) == text


@pytest.mark.parametrize(
    'text',
    [
        'f"{x',
        'f"{x"',
        'f"{}"',
        'f"{ }"',
        'f"{(}"',
        'f"x',
        'f"x\n"',
        'f"{"x}"',
        'f"{f"{x}"',
        'f"""x"',
    ],
)
def test_an_f_string_that_does_not_end_is_left(text: str) -> None:
    assert without_f_strings(f'a = f"{{1}}"; b = {text}') == f"a = ''; b = {text}"
