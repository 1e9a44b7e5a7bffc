"""The kind of an error decides what follows from it; the words of a program do not."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest
from user_files import LocalCode

from barc_sim.errors import UserError
from barc_sim.lab.confined.process import JudgedCode
from barc_sim.lab.files import ErrorKind, UserCodeError
from barc_sim.lab.labs.hills import HILLS
from barc_sim.lab.user_code.code import UserCode

if TYPE_CHECKING:
    from pathlib import Path

    from barc_sim.lab.judge import Finding

#: A function of each part that raises an error with a text.
RAISES = {
    'bike_model.py': """\
def bikeFE(x, y, psi, v, a, d_f, a0, m, Ff, theta, ts):
    raise ValueError({!r})
""",
    'relay.py': """\
def relay(linear_x, angular_z):
    raise ValueError({!r})
""",
}
PARTS = {'bike_model.py': 'model', 'relay.py': 'relay'}


def findings_on(folder: Path, name: str, text: str) -> list[Finding]:
    """Return the findings on one file."""
    path = folder / name
    path.write_text(RAISES[name].format(text), encoding='utf-8')
    findings = HILLS.judge(LocalCode(UserCode({PARTS[name]: path}, is_judged=True)))
    return [each for each in findings if each.criterion in HILLS.parts[PARTS[name]].labels]


@pytest.mark.parametrize(
    ('name', 'text'),
    [
        ('bike_model.py', 'this needs Python 3.99'),
        ('relay.py', 'a person judges it'),
        ('relay.py', 'it is not written yet (TODO)'),
    ],
)
def test_no_words_of_an_exception_keep_its_points_open(
    tmp_path: Path, name: str, text: str
) -> None:
    findings = findings_on(tmp_path, name, text)
    assert text in findings[0].message
    assert {(each.score, each.open, each.skipped) for each in findings} == {(0.0, False, False)}


@pytest.mark.usefixtures('confinement')
def test_a_function_that_only_names_a_loop_is_called_again(tmp_path: Path) -> None:
    text = RAISES['bike_model.py'].format('is there an endless loop? {}')
    text = text.replace("')", "'.format(x))")
    (tmp_path / 'bike_model.py').write_text(text, encoding='utf-8')
    with JudgedCode(tmp_path) as code:
        for x in range(5):
            with pytest.raises(UserError, match=f'loop. {x}.0'):
                code.rows('bikeFE', [[float(x)] * 11])


@pytest.mark.usefixtures('confinement')
@pytest.mark.parametrize(
    ('text', 'kind'),
    [
        ('raise NotImplementedError', ErrorKind.NOT_WRITTEN),
        ('while True: pass', ErrorKind.ENDLESS),
        ('return 1 / 0', ErrorKind.OTHER),
    ],
)
def test_the_kind_of_an_error_reaches_the_grader(
    tmp_path: Path, text: str, kind: ErrorKind
) -> None:
    (tmp_path / 'relay.py').write_text(
        f'def relay(linear_x, angular_z):\n    {text}\n', encoding='utf-8'
    )
    with JudgedCode(tmp_path) as code, pytest.raises(UserCodeError) as caught:
        code.call('relay_commands', [], 1.0, [(0.0, 0.0, 0.0), (0.05, 0.0, 0.0)])
    assert caught.value.kind is kind
