"""The table of `scripts/bench`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

BENCHMARKS = Path(__file__).parents[2] / 'scripts' / 'benchmarks'


@pytest.fixture
def compare(monkeypatch: pytest.MonkeyPatch) -> Any:  # noqa: ANN401 (a module)
    monkeypatch.syspath_prepend(BENCHMARKS)
    import _compare  # type: ignore[import-not-found]  # noqa: PLC0415

    return _compare


def test_subjects_are_measured_in_turns(compare: Any) -> None:  # noqa: ANN401
    turns = []

    def measure(case: str, subject: str) -> dict[str, float]:
        turns.append(f'{case} {subject}')
        return {'round trips/s': float(len(turns))}

    results = compare.measure_in_turns({'alone': ['quick', 'multi']}, 2, measure)
    assert turns == ['alone quick', 'alone multi'] * 2
    assert results['alone']['multi'] == [{'round trips/s': 2.0}, {'round trips/s': 4.0}]


def test_the_ratio_compares_medians_with_those_of_the_first_subject(compare: Any) -> None:  # noqa: ANN401
    quick = [{'round trips/s': rate} for rate in (3.0, 40.0, 5.0)]
    multi = [{'round trips/s': 2.0}, None]
    text = compare.table({'alone': {'quick': quick, 'multi': multi}}, {'multi': 'Multi'})
    rows = [line.split() for line in text.splitlines()]
    assert rows[1] == ['quick', '5.00', '[3.00,', '40.0]', '1.00']
    assert rows[2] == ['Multi', '2.00', '[2.00,', '2.00]', '2.50']


@pytest.mark.parametrize('ratio', [True, False])
def test_a_first_subject_without_an_end_leaves_the_figures_of_the_others(
    compare: Any,  # noqa: ANN401
    ratio: bool,
) -> None:
    results = {'busy': {'stock': [None], 'quick': [{'round trips/s': 2.0}]}}
    rows = [line.split() for line in compare.table(results, ratio=ratio).splitlines()]
    assert rows[1] == ['stock', 'no', 'end']
    assert rows[2] == ['quick', '2.00', '[2.00,', '2.00]']


def test_a_case_in_which_no_subject_ends_has_a_table(compare: Any) -> None:  # noqa: ANN401
    rows = compare.table({'busy': {'stock': [None]}}).splitlines()
    assert rows[1].split() == ['stock', 'no', 'end']
