"""Schemas from type descriptions."""

from __future__ import annotations

import json
from typing import Any

import pytest

pytest.importorskip('rclpy')

from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from barc_sim.bags.schemas import definition, share
from barc_sim.bags.type_descriptions import definition as described


def installed(package: str, kind: str, base: str) -> tuple[list[dict[str, Any]], dict[str, str]]:
    """Return the descriptions of a type and of those it refers to, and their hashes."""
    content = json.loads((share(package) / kind / f'{base}.json').read_text())
    found = content['type_description_msg']
    hashes = {entry['type_name']: entry['hash_string'] for entry in content['type_hashes']}
    return [found['type_description'], *found['referenced_type_descriptions']], hashes


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
    types.register(get_types_from_msg(described(name, descriptions), name))
    assert types.hash_rihs01(name) == hashes[name]


def test_parts_of_a_service_keep_their_full_names() -> None:
    assert definition('std_srvs/srv/SetBool_Event').splitlines()[:3] == [
        'service_msgs/ServiceEventInfo info',
        'std_srvs/srv/SetBool_Request[<=1] request',
        'std_srvs/srv/SetBool_Response[<=1] response',
    ]
    assert 'MSG: std_srvs/srv/SetBool_Response\nbool success\nstring message\n' in definition(
        'std_srvs/srv/SetBool_Event'
    )


def test_a_missing_part_is_named() -> None:
    descriptions, _ = installed('std_msgs', 'msg', 'Header')
    with pytest.raises(LookupError, match="no description of 'builtin_interfaces/msg/Time'"):
        described('std_msgs/msg/Header', descriptions[:1])


def test_a_field_that_ros2msg_cannot_express_is_named() -> None:
    field = {'name': 'x', 'type': {'type_id': 12, 'nested_type_name': ''}}
    with pytest.raises(LookupError, match='no ros2msg name for the field type 12'):
        described('a/msg/B', [{'type_name': 'a/msg/B', 'fields': [field]}])
