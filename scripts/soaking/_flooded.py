"""A run that watches its car until SIGINT; prints its bag's path and, as JSON, what it observed."""

from __future__ import annotations

import json
import sys
from dataclasses import asdict, dataclass, field
from math import isfinite
from typing import TYPE_CHECKING

from _figures import memory

from barc_sim import run
from barc_sim.vehicle.plant import Plant

if TYPE_CHECKING:
    from barc_sim.vehicle.plant import Observation

_MEMORY_PERIOD = 25  #: states from one look at the memory to the next


@dataclass
class _Extremes:
    """What the states of a run were at most."""

    states: int = 0
    not_finite: int = 0  #: states
    speed: float = 0.0  #: [m/s]
    motor: float = 0.0  #: [m/s²]
    servo: float = 0.0  #: [rad]
    memory: list[int] = field(default_factory=list)  #: [bytes]

    def include(self, observation: Observation) -> None:
        """Include a state."""
        true = observation.true
        acting = observation.acting
        self.states += 1
        if not all(map(isfinite, (*true, *acting))):
            self.not_finite += 1

        self.speed = max(self.speed, abs(true.v_x))
        self.motor = max(self.motor, abs(acting.motor))
        self.servo = max(self.servo, abs(acting.servo))
        if self.states % _MEMORY_PERIOD == 0:
            self.memory.append(memory())


class _WatchedPlant(Plant):
    """Includes each state in `extremes`, which all plants of the process share."""

    extremes = _Extremes()

    def observe(self) -> Observation:
        observation = super().observe()
        self.extremes.include(observation)
        return observation


def main() -> int:
    """Run the command line."""
    from barc_sim.vehicle import parameters  # noqa: PLC0415

    parameters.Plant = _WatchedPlant  # type: ignore[attr-defined]
    code = run.main()
    print(json.dumps(asdict(_WatchedPlant.extremes)))
    return code


if __name__ == '__main__':
    sys.exit(main())
