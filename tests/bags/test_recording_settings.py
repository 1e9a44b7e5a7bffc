"""The settings of a recording: which topics it selects, and what it refuses."""

from __future__ import annotations

import re
from typing import Any

import pytest

from barc_sim.bags.recording_settings import Recording
from barc_sim.errors import UserError

TOPICS = {
    '/scan': 'sensor_msgs/msg/LaserScan',
    '/front/scan': 'sensor_msgs/msg/LaserScan',
    '/odom': 'nav_msgs/msg/Odometry',
    '/_debug': 'std_msgs/msg/String',
    '/arm/_action/feedback': 'arm_msgs/action/Move_FeedbackMessage',
}


@pytest.mark.parametrize(
    ('settings', 'selected'),
    [
        ({}, {'/scan', '/front/scan', '/odom'}),
        ({'include_hidden_topics': True}, set(TOPICS)),
        ({'topic_types': ['nav_msgs/msg/Odometry']}, {'/odom'}),
        ({'topic_types': ['std_msgs/msg/String']}, set()),
        ({'topic_types': ['std_msgs/msg/String'], 'include_hidden_topics': True}, {'/_debug'}),
        (
            {'topics': [re.compile('^/scan')], 'topic_types': ['nav_msgs/msg/Odometry']},
            {'/scan', '/odom'},
        ),
        ({'exclude_topic_types': ['sensor_msgs/msg/LaserScan']}, {'/odom'}),
        (
            {'topic_types': ['sensor_msgs/msg/LaserScan'], 'exclude': [re.compile('front')]},
            {'/scan'},
        ),
    ],
)
def test_topics_are_selected_by_name_and_by_type(
    settings: dict[str, Any], selected: set[str]
) -> None:
    recording = Recording(**settings)
    assert {name for name, kind in TOPICS.items() if recording.wants(name, [kind])} == selected


@pytest.mark.parametrize(
    ('settings', 'sentence'),
    [
        ({'compression_format': 'gzip'}, r"there is no compression format 'gzip': choose one of"),
        ({'storage_preset_profile': 'slow'}, r"no storage preset profile 'slow': choose one of"),
        ({'max_bag_size': -1}, r'max_bag_size -1 is negative: give 0 or more'),
        ({'snapshot_mode': True, 'max_cache_size': 0}, r'a snapshot needs a cache'),
    ],
)
def test_settings_that_make_no_recording_are_refused(
    settings: dict[str, Any], sentence: str
) -> None:
    with pytest.raises(UserError, match=sentence):
        Recording(**settings)
