"""How often something happens, in the words of `ros2 topic hz`."""

from __future__ import annotations

from statistics import fmean, pstdev
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Sequence


def in_words(times: Sequence[int]) -> str:
    """Return the mean rate [Hz] of what happened at `times` [ns], and how even it was [s].

    The window is the number of periods between them.
    """
    if len(times) < 2:  # noqa: PLR2004 (a period has two ends)
        return f'{["no message", "1 message"][len(times)]}'
    periods = [(new - old) * 1e-9 for old, new in zip(times, times[1:])]  # noqa: B905, RUF007 (as many as there are; pairwise is as good)
    mean = fmean(periods)
    return (
        f'average rate: {1.0 / mean if mean else 0.0:.3f} min: {min(periods):.3f}s '
        f'max: {max(periods):.3f}s std dev: {pstdev(periods):.5f}s window: {len(periods)}'
    )
