"""Message definitions as a bag has them."""

from __future__ import annotations

import json
import re
from typing import Any

import pytest
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from barc_sim.bags.schemas import definition, definition_of, share
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
    _, hashes = installed(*name.split('/'))
    types = get_typestore(Stores.EMPTY)
    types.register(get_types_from_msg(definition(name), name))
    assert types.hash_rihs01(name) == hashes[name]


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


def installed(package: str, kind: str, base: str) -> tuple[list[dict[str, Any]], dict[str, str]]:
    """Return the descriptions of a type and of those it refers to, and their hashes."""
    content = json.loads((share(package) / kind / f'{base}.json').read_text())
    found = content['type_description_msg']
    hashes = {entry['type_name']: entry['hash_string'] for entry in content['type_hashes']}
    return [found['type_description'], *found['referenced_type_descriptions']], hashes


@needs_ros
@pytest.mark.parametrize(
    'name',
    [
        'barc_interfaces/msg/ZDynBkMdl',
        'geometry_msgs/msg/PoseWithCovariance',
        'nav_msgs/msg/Odometry',
        'rcl_interfaces/msg/ParameterEvent',
        'rcl_interfaces/msg/ParameterDescriptor',
        'type_description_interfaces/msg/TypeDescription',
    ],
)
def test_schema_has_the_hash_of_the_described_type(name: str) -> None:
    package, kind, base = name.split('/')
    descriptions, hashes = installed(package, kind, base)
    types = get_typestore(Stores.EMPTY)
    types.register(get_types_from_msg(definition_of(name, descriptions), name))
    assert types.hash_rihs01(name) == hashes[name]


@needs_ros
def test_parts_of_a_service_keep_their_full_names() -> None:
    assert definition('std_srvs/srv/SetBool_Event').splitlines()[:3] == [
        'service_msgs/ServiceEventInfo info',
        'std_srvs/srv/SetBool_Request[<=1] request',
        'std_srvs/srv/SetBool_Response[<=1] response',
    ]
    assert 'MSG: std_srvs/srv/SetBool_Response\nbool success\nstring message\n' in definition(
        'std_srvs/srv/SetBool_Event'
    )


@needs_ros
def test_a_missing_part_is_named() -> None:
    descriptions, _ = installed('std_msgs', 'msg', 'Header')
    with pytest.raises(LookupError, match="no description of 'builtin_interfaces/msg/Time'"):
        definition_of('std_msgs/msg/Header', descriptions[:1])


def test_a_field_that_ros2msg_cannot_express_is_named() -> None:
    field = {'name': 'x', 'type': {'type_id': 12, 'nested_type_name': ''}}
    with pytest.raises(LookupError, match='no ros2msg name for the field type 12'):
        definition_of('a/msg/B', [{'type_name': 'a/msg/B', 'fields': [field]}])
