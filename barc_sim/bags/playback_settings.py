"""The settings of a playback: what to play of a bag, and how."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

from barc_sim.interfaces.parameters import ParameterDeclaration

if TYPE_CHECKING:
    import re
    from collections.abc import Mapping, Sequence

RATE = ParameterDeclaration(
    'rate', 1.0, 'seconds of the bag played per second', between=(1e-3, 1e3)
)
SEEK_TO = ParameterDeclaration(
    'seek_to', 0.0, 'set it to continue at this time after the start of the bag [s]'
)


class Playback(NamedTuple):
    """The settings of a playback."""

    rate: float = 1.0
    loop: bool = False
    start_offset: float = 0.0  #: [s]; earlier messages of latched topics are published first, once
    duration: float | None = None  #: [s] of the bag to play from there; None: no limit
    until: int | None = None  #: [ns] since the epoch; with `duration`, the later end counts
    delay: float = 0.0  #: [s] to wait before the bag begins, each time
    start_paused: bool = False
    topics: Sequence[re.Pattern[str]] = ()  #: see `selected`
    exclude: Sequence[re.Pattern[str]] = ()
    qos_overrides: Mapping[str, Mapping[str, Any]] = {}  #: by topic, see `read_qos_overrides`
    clock: float | None = None  #: [Hz] of `/clock`; None: only the bag's own, if it has one

    def end(self, start: int) -> int | None:
        """Return the time in the bag at which to end [ns], if it begins at `start`; None: none."""
        ends: list[int] = []
        if self.duration is not None:
            ends.append(start + int(self.duration * 1e9))
        if self.until is not None:
            ends.append(self.until)
        return max(ends, default=None)
