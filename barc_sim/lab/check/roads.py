"""Seeded random roads, within what the car's motor can climb."""

from __future__ import annotations

from random import Random

from barc_sim.vehicle.road import Road

STEEPEST_DEG = 25.0
_STRETCHES = 5
_LEAST, _MOST = 15.0, 30.0  #: [m] of a stretch


def random_road(seed: int, number: int) -> tuple[Road, float]:
    """Return road `number` of the seed and its length [m]: 20 m on the flat, then five grades."""
    random = Random(f'{seed} road {number}')  # noqa: S311 (a simulation, not a secret)
    starts, grades = [0.0], [0.0]
    end = 20.0
    for _ in range(_STRETCHES):
        starts.append(end)
        grades.append(round(random.uniform(-STEEPEST_DEG, STEEPEST_DEG), 1))
        end = round(end + random.uniform(_LEAST, _MOST), 1)
    return Road(tuple(starts), tuple(grades), name=f'random {number + 1}'), end
