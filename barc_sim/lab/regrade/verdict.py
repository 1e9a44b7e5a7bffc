"""The verdict on a run and one piece of code."""

from __future__ import annotations

from dataclasses import dataclass

#: Allowed deviation, relative to max(|value|, 1): rounding on another machine or with noise.
TOLERANCE = 1e-9


@dataclass
class Verdict:
    """Whether the recording could have come from the code.

    Examples
    --------
    >>> verdict = Verdict('states', 'bike_model.py')
    >>> verdict.add(deviation(8.0, 8.0), 'v at 0 s')
    >>> verdict.possible, verdict.exact
    (True, 1)
    """

    part: str  #: 'model' or 'controller'
    code: str  #: whose
    values: int = 0  #: compared states or commands
    exact: int = 0  #: equal ones, bit for bit
    greatest: float = 0.0  #: greatest deviation, relative to max(|value|, 1)
    deviating: int = 0  #: those that deviate by more than `TOLERANCE`
    first: str = ''  #: a sentence on the first of them, or on how the code failed
    resets: int = 0
    placements: int = 0
    gaps: int = 0  #: missing states

    @property
    def possible(self) -> bool:
        """Whether the recording could have come from the code."""
        return self.values > 0 and not self.first

    def add(self, deviation: float, message: str) -> None:
        """Count a value with its `deviation`; `message` describes it."""
        self.values += 1
        if deviation == 0.0:
            self.exact += 1
        self.greatest = max(self.greatest, deviation)
        if not deviation <= TOLERANCE:
            self.deviating += 1
            self.first = self.first or message

    def fail(self, message: str) -> None:
        """Store how the code failed."""
        self.first = self.first or message

    def in_words(self) -> str:
        """Return the verdict in one line."""
        if not self.values and not self.first:
            return 'nothing to compare'
        if not self.possible:
            return f'no: {self.first}' + (
                f' ({self.deviating} of {self.values} deviate)' if self.deviating else ''
            )
        if self.exact == self.values:
            return f'yes, bit for bit ({self.values} of {self.values})'
        return f'yes, within {self.greatest:.1e} ({self.exact} of {self.values} bit for bit)'


def deviation(found: float, expected: float) -> float:
    """Return the deviation of `found`, relative to max(|expected|, 1); infinite for NaN."""
    if found == expected:
        return 0.0
    off = abs(found - expected) / max(1.0, abs(expected))
    return off if off == off else float('inf')  # noqa: PLR0124 (NaN)
