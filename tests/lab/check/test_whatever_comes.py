"""Numbers of any size are judged without a warning, and none of them scores by chance."""

from __future__ import annotations

from types import SimpleNamespace
from typing import TYPE_CHECKING

import pytest
from user_files import LocalCode

from barc_sim.lab.hills.lab import judge

if TYPE_CHECKING:
    from collections.abc import Callable

HUGE, TINY = 1.7e308, 1e-320


class Counting:
    """A PID that answers by the number of the call."""

    def __init__(self, answer: Callable[[int, float], float]) -> None:
        """Answer what `answer` says."""
        self._answer = answer
        self._calls = 0

    def reset(self) -> bool:
        """Return that there is nothing to clear."""
        return False

    def acc_calculate(self, reference: float, current: float, _: float) -> float:
        """Return the answer to this call and error."""
        self._calls += 1
        return self._answer(self._calls, reference - current)


@pytest.mark.parametrize(
    'model',
    [
        lambda *_, **__: [HUGE, -HUGE, HUGE, -HUGE],
        lambda *_, **__: [TINY] * 4,
        lambda x, y, psi, v, *_, **__: [x + 0.02 * v, y, psi, v - 1e200],
        lambda x, y, psi, v, *_, **__: [x + 1e5 * v, y, psi, 1e3 * v + 1.0],
    ],
)
def test_any_state(model: Callable[..., list[float]]) -> None:
    findings = judge(LocalCode(SimpleNamespace(paths=['model'], model=model)))
    assert all(0.0 <= finding.score < 0.2 for finding in findings)


@pytest.mark.parametrize(
    'answer',
    [
        lambda *_: HUGE,
        lambda k, _: HUGE * (-1.0) ** k,
        lambda *_: TINY,
        lambda _, e: 1e200 * e,
        lambda k, _: HUGE if k == 1 else 0.0,
    ],
)
def test_any_acceleration(answer: Callable[[int, float], float]) -> None:
    findings = judge(
        LocalCode(
            SimpleNamespace(
                paths=['controller'],
                new_pid=lambda *_, **__: Counting(answer),
                gains=None,
                tolerated=(),
            )
        )
    )
    assert all(0.0 <= finding.score <= 1.0 for finding in findings)
    assert [finding.score for finding in findings[7:10]] == [0.0] * 3
