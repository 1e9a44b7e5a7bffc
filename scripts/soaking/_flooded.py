"""A run that watches its car until SIGINT; prints its bag's path and, as JSON, what it saw."""

from __future__ import annotations

import json
import sys
from math import isfinite
from typing import TYPE_CHECKING

from _figures import memory

from barc_sim import run
from barc_sim.vehicle.plant import Plant

if TYPE_CHECKING:
    from barc_sim.vehicle.plant import Observation

_EVERY = 25  #: states from one look at the memory to the next


class _Watched(Plant):
    """Keeps what is to be told of all states."""

    not_finite = 0
    speed = motor = servo = 0.0
    seen = 0
    memory: tuple[int, ...] = ()

    def observe(self) -> Observation:
        seen = super().observe()
        kind = type(self)
        kind.seen += 1
        kind.not_finite += not all(map(isfinite, (*seen.true, *seen.acting)))
        kind.speed = max(kind.speed, abs(seen.true.v_x))
        kind.motor = max(kind.motor, abs(seen.acting.motor))
        kind.servo = max(kind.servo, abs(seen.acting.servo))
        if kind.seen % _EVERY == 0:
            kind.memory += (memory(),)
        return seen


def main() -> int:
    """Run the command line."""
    from barc_sim.vehicle import parameters  # noqa: PLC0415

    parameters.Plant = _Watched  # type: ignore[attr-defined]
    code = run.main()
    names = ('not_finite', 'speed', 'motor', 'servo', 'seen', 'memory')
    print(json.dumps({name: getattr(_Watched, name) for name in names}))
    return code


if __name__ == '__main__':
    sys.exit(main())
