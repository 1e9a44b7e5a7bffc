"""The rule that ends the run of a car that never arrives."""

from __future__ import annotations

from math import inf, nan
from typing import TYPE_CHECKING

import pytest

from barc_sim.simulation.progress import STALL_TIMEOUT, Progress

if TYPE_CHECKING:
    from collections.abc import Callable

TS = 0.02
LAB = 180.0  #: [m]
Motion = tuple[float, float]  #: x [m], v [m/s]


def follow(
    motion: Callable[[float], Motion],
    *,
    distance: float = LAB,
    duration: float = 300.0,
    reference: Callable[[float], float] = lambda _: 8.0,
) -> tuple[float, str]:
    """Return when [s] a car that moves so is given up, and why; infinity if it never is."""
    progress = Progress(distance)
    for k in range(round(duration / TS)):
        t = k * TS
        x, v = motion(t)
        if progress.add(t, x, v, reference(t)):
            return t, progress.failure
    return inf, progress.failure


@pytest.mark.parametrize(
    ('motion', 'gave_up', 'does'),
    [
        (lambda _: (8.0, 8.0), 20.0, 'stands at 8.0 m: the model returns the speed in place of x'),
        (lambda t: (3.0, t), 20.0, 'stands at 3.0 m, and its speed is 20.02 m/s: the model does'),
        (lambda _: (0.0, 0.0), 20.0, 'stands at 0.0 m: the commands do not move it'),
        (lambda t: (-t, -1.0), 20.0, 'drives backwards, to -20.02 m: is the error'),
        (
            lambda t: (5.0 - abs(5.0 - t), -1.0),
            25.0,
            'is at -15.0 m, at -1.00 m/s, and was at 5.0 m; it got no further for 20 s',
        ),
        (
            lambda t: (0.1 * t, 0.1),
            225.0,
            'is at 22.5 m, at 0.10 m/s, and was at 22.5 m; at the speed to hold it would have',
        ),
        # It diverges, and is at rest in every other step.
        (
            lambda t: (-(1.1 ** (t / TS)), -(1.1 ** (t / TS)) if round(t / TS) % 2 else 0.0),
            20.0,
            'drives backwards, to -',
        ),
        # It is put elsewhere in every step: nobody does that.
        (lambda t: (-2.0 * (round(t / TS) % 2), 0.0), 20.0, 'drives backwards, to -2 m'),
        (lambda _: (-3.0, 0.0), 20.0, 'stands at -3.0 m: the commands do not move it'),
        (lambda _: (nan, 1.0), 20.0, 'has no position: the model returns nan for x; it got no'),
    ],
)
def test_a_car_that_never_arrives_is_given_up(
    motion: Callable[[float], Motion], gave_up: float, does: str
) -> None:
    t, failure = follow(motion)

    assert t == pytest.approx(gave_up, abs=2 * TS)
    assert failure.startswith(f'the car {does}')


@pytest.mark.parametrize(
    ('motion', 'options'),
    [
        (lambda t: (2.0 * t, 2.0), {}),
        (lambda t: (max(t - 19.0, 0.0) * 8.0, 8.0), {}),
        (lambda _: (0.0, 0.0), {'distance': inf}),
        (lambda _: (LAB, 0.0), {}),
        # Put back to the start every 15 s.
        (lambda t: (t % 15.0, 1.0 if t % 15.0 else 0.0), {'duration': 200.0}),
    ],
)
def test_a_car_on_its_way_is_not(
    motion: Callable[[float], Motion], options: dict[str, float]
) -> None:
    assert follow(motion, **options) == (inf, '')  # type: ignore[arg-type]


def test_a_car_may_stand_where_its_reference_became_zero() -> None:
    def motion(t: float) -> Motion:
        return (8.0 * min(t, 5.0), 0.0 if t > 5.0 else 8.0)

    assert follow(motion, reference=lambda t: 8.0 if t < 5.0 else 0.0)[0] == inf
    assert follow(motion)[0] == pytest.approx(5.0 + STALL_TIMEOUT, abs=2 * TS)
    assert follow(lambda _: (0.0, 0.0), reference=lambda _: 0.0)[0] == pytest.approx(
        STALL_TIMEOUT, abs=2 * TS
    )


@pytest.mark.parametrize(
    'reference',
    [
        lambda t: 0.0 if 5.0 < t < 235.0 else 8.0,
        lambda t: 0.5 if t < 250.0 else 8.0,
    ],
    ids=['stood on request', 'slow on request'],
)
def test_a_car_has_the_time_that_its_references_allow(reference: Callable[[float], float]) -> None:
    xs, x = [], 0.0
    for k in range(15_000):
        xs.append(x)
        x += 0.9 * reference(k * TS) * TS

    def motion(t: float) -> Motion:
        k = round(t / TS)
        return min(xs[k], LAB), 0.9 * reference(t)

    assert follow(motion, reference=reference) == (inf, '')
