"""`scripts/readability` counts what its help describes."""

from __future__ import annotations

from importlib.machinery import SourceFileLoader
from importlib.util import module_from_spec, spec_from_loader
from pathlib import Path
from typing import Any

import pytest

HERE = Path(__file__).parent
SAMPLE = HERE / 'readability_sample.txt'


@pytest.fixture(scope='module')
def readability() -> Any:  # noqa: ANN401 (a module)
    loader = SourceFileLoader('readability', str(HERE.parents[1] / 'scripts' / 'readability'))
    module = module_from_spec(spec_from_loader('readability', loader))  # type: ignore[arg-type]
    loader.exec_module(module)
    return module


def test_each_kind_of_dense_line_is_counted_in_a_sample(
    readability: Any,  # noqa: ANN401 (a module)
) -> None:
    counts = readability.count(SAMPLE.read_text(encoding='utf-8'))

    assert counts['lines'] == 10, 'neither docstrings nor comments nor blank lines'
    assert counts['packed'] == 1
    assert counts['pairs'] == 2, 'a swap, and coordinates'
    assert counts['starred'] == 1
    assert counts['partial'] == 1
    assert counts['nested'] == 2, 'two loops in one, and one in another'
    assert (counts['blank'], counts['body_lines']) == (2, 10)
    assert counts['names'] == 1, '`given`; but not `each` in a comprehension'


def test_each_room_and_another_package_have_a_row(
    readability: Any,  # noqa: ANN401 (a module)
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    for place in ('barc_sim/vehicle/law.py', 'tests/test_law.py', '.venv/lib/other.py'):
        (tmp_path / place).parent.mkdir(parents=True)
        (tmp_path / place).write_text('a, b = 1, 2\n', encoding='utf-8')
    (tmp_path / 'tests' / 'broken.py').write_text('a, b =\n', encoding='utf-8')

    readability.main(['--tree', str(tmp_path), 'pytest'])

    output, errors = capsys.readouterr()
    heading, *rows = output.splitlines()
    figures = {row[:24].strip(): row[24:].split() for row in rows}
    assert heading.split()[:2] == ['lines', 'packed']
    assert [*figures] == ['barc_sim/vehicle', 'tests', 'all of barc_sim', 'all', 'pytest']
    assert figures['barc_sim/vehicle'][:2] == ['1', '1000.0']
    assert figures['all'][0] == '2'
    assert 'broken.py' in errors


def test_a_package_that_is_not_installed_is_named(
    readability: Any,  # noqa: ANN401 (a module)
    capsys: pytest.CaptureFixture[str],
) -> None:
    with pytest.raises(SystemExit):
        readability.main(['no_such_package'])
    assert "'no_such_package' is not installed" in capsys.readouterr().err
