"""Schemas of messages, services and actions, as a bag has them."""

from __future__ import annotations

import json

import pytest
from rosbags.typesys import Stores, get_typestore

from barc_sim.bags import messages
from barc_sim.bags.messages import Topic
from barc_sim.bags.schemas import schema, types_of
from barc_sim.cli.process import has_ros
from barc_sim.interfaces.definitions import installed

needs_ros = pytest.mark.skipif(not has_ros(), reason='compares with what ROS has installed')


@needs_ros
def test_parts_of_services_and_actions_have_the_hashes_of_ros() -> None:
    checked = 0
    for name, path in installed().items():
        if path.suffix == '.msg':
            continue
        content = json.loads(path.with_suffix('.json').read_text())
        hashes = {each['type_name']: each['hash_string'] for each in content['type_hashes']}
        services = {name, f'{name}_SendGoal', f'{name}_GetResult'}
        for part in {each for each in hashes if each.startswith(f'{name}_')} - services:
            text, encoding = schema(part)
            types = get_typestore(Stores.EMPTY)
            types.register(
                types_of(
                    Topic(
                        name='/part',
                        type=part,
                        definition=text,
                        schema_encoding=encoding,
                        type_hash='',
                        offered_qos=[],
                    )
                )
            )
            assert types.hash_rihs01(part) == hashes[part]
            checked += 1
    assert checked > 50


def test_a_type_without_fields_has_the_field_of_its_cdr() -> None:
    text = messages.topic('/stop', 'std_msgs/msg/Empty').definition
    assert text == 'uint8 structure_needs_at_least_one_member\n'


def test_a_schema_that_is_not_installed_is_named() -> None:
    for name in ('nobody/msg/A', 'nobody/srv/A_Event', 'a_b', 'std_msgs/msg/Header_B', ''):
        with pytest.raises(LookupError):
            schema(name)
