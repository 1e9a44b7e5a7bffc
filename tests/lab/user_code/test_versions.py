"""A file of any version of Python and NumPy: the same points, or none lost."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING

import numpy as np
import pytest
from user_files import PLAIN_CONTROLLER, PLAIN_MODEL, LocalCode, replaced

from barc_sim.lab.files import read_source
from barc_sim.lab.labs.hills import HILLS
from barc_sim.lab.user_code.code import UserCode
from barc_sim.lab.user_code.numpy_names import ADDED, REMOVED

if TYPE_CHECKING:
    from pathlib import Path

    from barc_sim.lab.judge import Finding


def judged(folder: Path, text: str) -> tuple[list[Finding], tuple[str, ...]]:
    """Return the findings on a controller, and what is tolerated."""
    path = folder / 'controller.py'
    path.write_text(text, encoding='utf-8')
    code = LocalCode(UserCode({'controller': path}, is_judged=True))
    judgements = [each for each in HILLS.judge(code) if not each.skipped]
    return judgements, code.tolerated()


@pytest.mark.parametrize('name', REMOVED)
def test_a_name_that_numpy_has_removed_works_and_is_named(tmp_path: Path, name: str) -> None:
    path = tmp_path / 'controller.py'
    path.write_text(
        f'import numpy as np\nfrom numpy import {name}\n{PLAIN_CONTROLLER}a = np.{name}\n'
    )
    code = UserCode({'controller': path}, is_judged=True).load()
    assert code.tolerated == (
        f'controller.py: np.{name} is no name of NumPy 2 any more: it still works here',
    )


@pytest.mark.parametrize('name', ADDED)
def test_a_name_that_numpy_has_added_works(tmp_path: Path, name: str) -> None:
    path = tmp_path / 'controller.py'
    path.write_text(f'import numpy as np\n{PLAIN_CONTROLLER}assert callable(np.{name})\n')
    assert UserCode({'controller': path}, is_judged=True).load().tolerated == ()


def test_removed_names_give_their_former_results(tmp_path: Path) -> None:
    text = replaced(
        PLAIN_CONTROLLER,
        ('class PID', 'import numpy as np\n\n\nclass PID'),
        ('self.total += e * dt', 'self.total += np.trapz([e, e], dx=dt) if e < np.Inf else np.NaN'),
    )
    findings, tolerated = judged(tmp_path, text)
    assert [each.score for each in findings] == [1.0] * 4
    assert len(tolerated) == 2


def test_numpy_itself_is_not_changed() -> None:
    assert not hasattr(np, 'Inf') or np.lib.NumpyVersion(np.__version__) < '2.0.0'


LATER = {
    'its own quotes': 'gains = {"kp": 1}\ntext = f"{gains["kp"]}"',
    'a backslash': 'text = f"{\'\\n\'.join([])}"',
    'a comment and a line': 'text = f"{1  # one\n}"',
    'a format': 'w = {"a": 3}\ntext = f"{1.0:{w["a"]}}"',
    'f-strings within': 'text = f"{f"{f"{1}"}"}"',
    'a type': 'type Gain = float',
    'a type parameter': 'def first[T](x: T) -> T:\n    return x',
}


@pytest.mark.parametrize('text', LATER.values(), ids=LATER.keys())
def test_syntax_of_a_later_python_costs_nothing(tmp_path: Path, text: str) -> None:
    findings, _ = judged(tmp_path, f'{PLAIN_CONTROLLER}\n{text}\n')
    if sys.version_info >= (3, 12):
        assert [each.score for each in findings] == [1.0] * 4
    else:
        assert all(each.open for each in findings)
        assert all(
            'needs Python 3.12, and this machine has 3.1' in each.message for each in findings
        )


@pytest.mark.parametrize('text', ['f"{x"', 'f"{}"', 'f"{1"', 'x = (f"{1}"', 'f"{a["b}"'])
def test_a_real_syntax_error_is_one_in_every_version(tmp_path: Path, text: str) -> None:
    findings, _ = judged(tmp_path, f'{PLAIN_CONTROLLER}\n{text}\n')
    assert [each.score for each in findings] == [0.0] * 4
    assert not any(each.open for each in findings)
    assert 'syntax error' in findings[0].message


SOURCES = {
    'Latin-1': '# -*- coding: latin-1 -*-\nx = "é"\n'.encode('latin-1'),
    'a byte order mark': b'\xef\xbb\xbfx = "\xc3\xa9"\n',
    'a byte order mark and tabs': b'\xef\xbb\xbfif 1:\n\tx = 0\n        x = "\xc3\xa9"\n',
    'lines of Windows': b'x = "\xc3\xa9"\r\ny = 1\r\n',
}


@pytest.mark.parametrize('data', SOURCES.values(), ids=SOURCES.keys())
def test_a_file_is_read_by_pythons_rules(tmp_path: Path, data: bytes) -> None:
    path = tmp_path / 'controller.py'
    path.write_bytes(
        data
        + PLAIN_CONTROLLER.encode()
        + b'assert x == "\xc3\xa9".encode().decode()\n'.replace(
            b'"\xc3\xa9".encode().decode()', b'chr(233)'
        )
    )

    code = UserCode({'controller': path}, is_judged=True).load()
    assert code.attachments() == {'student/controller.py': path.read_bytes()}
    assert read_source(path, 'controller.py').data == path.read_bytes()


def test_random_numbers_give_the_same_points_each_time(tmp_path: Path) -> None:
    text = replaced(
        PLAIN_CONTROLLER,
        ('class PID', 'import random\nimport numpy as np\n\n\nclass PID'),
        ('return output', 'return output + 0.5 * random.random() + 0.2 * np.random.rand()'),
    )
    first, again = (judged(tmp_path, text)[0] for _ in range(2))
    assert first == again
    assert 'random numbers' in first[0].message


def test_a_wrapped_heading_is_right(tmp_path: Path) -> None:
    path = tmp_path / 'bike_model.py'
    wrapped = (
        'psi_next = (psi_next + 3.141592653589793) % (2 * 3.141592653589793) - 3.141592653589793'
    )
    text = replaced(PLAIN_MODEL, ('    v_next = v', f'    {wrapped}\n    v_next = v'))
    path.write_text(text, encoding='utf-8')
    findings = HILLS.judge(LocalCode(UserCode({'model': path}, is_judged=True)))
    assert [each.score for each in findings[:4]] == [1.0] * 4
