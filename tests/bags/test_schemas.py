"""Message definitions as a bag has them."""

from __future__ import annotations

import json
import re

import pytest
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from barc_sim.bags.schemas import definition, share
from barc_sim.cli.process import has_ros

needs_ros = pytest.mark.skipif(not has_ros(), reason='compares with what ROS has installed')

TYPES = [
    'barc_interfaces/msg/ECU',
    'barc_interfaces/msg/EZDynBkMdl',
    'barc_interfaces/msg/Environment',
    'barc_interfaces/msg/PidState',
    'barc_interfaces/msg/ZDynBkMdl',
    'geometry_msgs/msg/Twist',
    'nav_msgs/msg/Odometry',
    'rcl_interfaces/msg/Log',
    'rcl_interfaces/msg/ParameterEvent',
]


@needs_ros
def test_dependencies_follow_depth_first_and_by_name_under_their_headings() -> None:
    text = definition('nav_msgs/msg/Odometry')
    assert text.startswith((share('nav_msgs') / 'msg' / 'Odometry.msg').read_text())
    assert re.findall(r'\n={80}\nMSG: (\S+)\n', text) == [
        'geometry_msgs/PoseWithCovariance',
        'geometry_msgs/Pose',
        'geometry_msgs/Point',
        'geometry_msgs/Quaternion',
        'geometry_msgs/TwistWithCovariance',
        'geometry_msgs/Twist',
        'geometry_msgs/Vector3',
        'std_msgs/Header',
        'builtin_interfaces/Time',
    ]


@needs_ros
@pytest.mark.parametrize('name', TYPES)
def test_definition_has_the_hash_of_the_installed_type(name: str) -> None:
    package, _, base = name.split('/')
    installed = json.loads((share(package) / 'msg' / f'{base}.json').read_text())
    expected = {entry['type_name']: entry['hash_string'] for entry in installed['type_hashes']}
    types = get_typestore(Stores.EMPTY)
    types.register(get_types_from_msg(definition(name), name))
    assert types.hash_rihs01(name) == expected[name]


@pytest.mark.parametrize(
    ('name', 'reason'),
    [
        ('no_such_msgs/msg/Header', "'no_such_msgs' is not installed"),
        pytest.param(
            'std_msgs/msg/NoSuchType',
            "'std_msgs/msg/NoSuchType' has no definition",
            marks=needs_ros,
        ),
        ('json/msg/Header', 'share/json'),
        ('../msg/Header', 'is not the name of a type'),
    ],
)
def test_what_is_not_installed_is_named(name: str, reason: str) -> None:
    with pytest.raises(LookupError, match=re.escape(reason)):
        definition(name)
