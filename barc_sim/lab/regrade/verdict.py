"""What is found of a run and some code."""

from __future__ import annotations

from dataclasses import dataclass

#: What a value may be off, of 1 or of itself: rounding, on another machine or under noise.
TOLERANCE = 1e-9


@dataclass
class Verdict:
    """Whether what was recorded could have come from some code."""

    part: str  #: 'model' or 'controller'
    code: str  #: whose
    values: int = 0  #: states or commands that were looked at
    exact: int = 0  #: those that come out bit for bit
    greatest: float = 0.0  #: deviation, of 1 or of the value
    deviating: int = 0  #: those that are off by more than `TOLERANCE`
    first: str = ''  #: the first of them, in words; or how the code failed
    resets: int = 0
    placements: int = 0
    gaps: int = 0  #: states that are missing

    @property
    def possible(self) -> bool:
        """Whether it could have."""
        return self.values > 0 and not self.first

    def add(self, deviation: float, said: str) -> None:
        """Count a value that is off by `deviation`; `said` tells of it."""
        self.values += 1
        if deviation == 0.0:
            self.exact += 1
        self.greatest = max(self.greatest, deviation)
        if not deviation <= TOLERANCE:
            self.deviating += 1
            self.first = self.first or said

    def fail(self, said: str) -> None:
        """Take note of how the code failed."""
        self.first = self.first or said

    def in_words(self) -> str:
        """Return it in a line."""
        if not self.values and not self.first:
            return 'nothing to compare'
        if not self.possible:
            return f'no: {self.first}' + (
                f' ({self.deviating} of {self.values} are off)' if self.deviating else ''
            )
        if self.exact == self.values:
            return f'yes, bit for bit ({self.values} of {self.values})'
        return f'yes, within {self.greatest:.1e} ({self.exact} of {self.values} bit for bit)'


def deviation(found: float, expected: float) -> float:
    """Return how far `found` is off, of 1 or of the value; NaN is off from everything."""
    if found == expected:
        return 0.0
    off = abs(found - expected) / max(1.0, abs(expected))
    return off if off == off else float('inf')  # noqa: PLR0124 (NaN)
