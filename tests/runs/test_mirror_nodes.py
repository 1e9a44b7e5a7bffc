"""A run with mirrors: what is published beside it, and that it is the same run."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

pytest.importorskip('rclpy')

from command_line import bag_of, messages

from barc_sim.bags import reader as bag
from barc_sim.simulation.closed_loop import closed_loop

if TYPE_CHECKING:
    from pathlib import Path

EACH_STATE = {'/odom'}
NOW_AND_THEN = {'/path', '/markers', '/road_markers', '/diagnostics'}
pytestmark = pytest.mark.usefixtures('ros_domain')


@pytest.mark.parametrize('engine', ['ros', 'local'])
def test_every_state_is_mirrored_and_the_run_is_the_same(engine: str, tmp_path: Path) -> None:
    options = ('--realtime-factor', 'max', '--distance', '10', '--mirrors')
    path = bag_of(tmp_path, *options, '--engine', engine)
    by_topic = messages(path)
    assert set(by_topic) > EACH_STATE | (NOW_AND_THEN - {'/diagnostics'})

    stamps = [state.header.stamp for state in by_topic['/z_vhcl']]
    for topic in EACH_STATE:
        assert [message.header.stamp for message in by_topic[topic]] == stamps, topic

    if engine == 'local':  # the wheels of ROS have no tf2_msgs
        frames = [
            (each.header.frame_id, each.child_frame_id) for each in by_topic['/tf'][0].transforms
        ]
        assert frames == [('map', 'odom'), ('odom', 'base_link')]
    assert np.array_equal(bag.read(path).v_x, closed_loop(distance=10.0).v_x)
    assert bag.info(path)['lost_messages'] == '0'


def test_mirrors_use_the_road_and_the_namespace_of_the_simulator(tmp_path: Path) -> None:
    (tmp_path / 'hill.csv').write_text('start_m,grade_deg\n0,20\n')
    options = ('--realtime-factor', 'max', '--distance', '20', '--mirrors')
    path = bag_of(tmp_path, *options, '--road', 'hill.csv', '--ros-args', '-r', '__ns:=/car2')
    by_topic = messages(path)
    last = by_topic['/car2/odom'][-1]
    assert last.pose.pose.position.z / last.pose.pose.position.x == pytest.approx(0.36397, abs=1e-5)
    assert last.header.frame_id == 'car2/odom'
