"""Messages that no test of the node can show where their package is missing."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

pytest.importorskip('rclpy')

from barc_sim.nodes.mirrors.messages import odometry_mirror, transform_mirror
from barc_sim.nodes.mirrors.ride import Ride
from barc_sim.ros.conversions import to_nanoseconds
from barc_sim.vehicle.bike_model import Motion, Vehicle
from barc_sim.vehicle.road import Road


def test_transform_is_the_pose_of_odom() -> None:
    state = Ride(Road.lab(), Vehicle()).update(7, Motion(110.0, 1.0, 0.3, 8.0, 0.0, 0.0), 0.0)
    (transform,) = transform_mirror('car2/', SimpleNamespace)(state).transforms
    odom = odometry_mirror('car2/')(state)
    there, turn = transform.transform.translation, transform.transform.rotation
    position = odom.pose.pose.position
    assert (there.x, there.y, there.z) == (position.x, position.y, position.z)
    assert turn == odom.pose.pose.orientation
    assert (transform.header, transform.child_frame_id) == (odom.header, 'car2/base_link')
    assert (transform.header.frame_id, to_nanoseconds(transform.header.stamp)) == ('car2/odom', 7)
