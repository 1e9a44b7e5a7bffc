"""A ride from state to state, and the path so far."""

from __future__ import annotations

from itertools import pairwise

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from barc_sim.nodes.mirrors.car import WHEEL_RADIUS
from barc_sim.nodes.mirrors.ride import MirroredState, Ride, Trail
from barc_sim.vehicle.bike_model import Motion, Vehicle
from barc_sim.vehicle.road import Road

STEP = 20_000_000  # [ns]
properties = settings(deadline=None, derandomize=True)


def states(v: float, count: int, x: float = 0.0) -> list[Motion]:
    """Return states of a car that goes straight on at a speed."""
    return [Motion(x + 0.02 * v * k, 0.0, 0.0, v, 0.0, 0.0) for k in range(count)]


def ride(motions: list[Motion], road: Road | None = None) -> list[MirroredState]:
    following = Ride(road or Road.flat(), Vehicle())
    return [following.update(STEP * k, motion, 0.0) for k, motion in enumerate(motions)]


def test_wheels_have_rolled_the_distance() -> None:
    *_, last = ride(states(8.0, 101))
    assert last.rolled == pytest.approx((16.0 / WHEEL_RADIUS,) * 4)


def test_reset_starts_a_new_ride() -> None:
    *_, last = ride([*states(8.0, 5, x=30.0), *states(0.0, 1)])
    assert last.is_first
    assert last.rolled == (0.0,) * 4
    assert last.acceleration == (0.0, 0.0, 0.0)


def test_trail_lies_on_the_hills() -> None:
    trail, road = Trail(), Road.lab()
    for state in ride(states(8.0, 400), road):
        trail.add(state)
    assert max(pose.z for _, pose in trail.poses) == pytest.approx(road.elevation(40.0))
    assert trail.poses[0][1][:3] == (0.0, 0.0, 0.0)


@properties
@given(v=st.floats(-40.0, 40.0), count=st.integers(1, 800), limit=st.integers(2, 30))
def test_trail_is_bounded_and_leads_from_the_start_to_here(
    v: float, count: int, limit: int
) -> None:
    trail = Trail(limit=limit)
    driven = ride(states(v, count))
    for state in driven:
        trail.add(state)
    assert len(trail.poses) <= limit
    assert trail.poses[0][1] == driven[0].pose
    step = 0.02 * abs(v)
    assert abs(trail.poses[-1][1].x - driven[-1].pose.x) <= trail.spacing + step
    for (_, one), (_, other) in pairwise(trail.poses):
        # What was taken at a finer spacing need not be a multiple of the present one.
        assert abs(other.x - one.x) >= 0.5
    stamps = [stamp for stamp, _ in trail.poses]
    assert stamps == sorted(set(stamps))


def test_standing_car_leaves_one_pose() -> None:
    trail = Trail()
    for state in ride(states(0.0, 500)):
        trail.add(state)
    assert len(trail.poses) == 1


def test_trail_of_a_new_ride_forgets_the_old_one() -> None:
    trail = Trail(limit=4)
    for state in ride([*states(8.0, 300), *states(0.0, 1)]):
        trail.add(state)
    assert [pose[:3] for _, pose in trail.poses] == [(0.0, 0.0, 0.0)]
