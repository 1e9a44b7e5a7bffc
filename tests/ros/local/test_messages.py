"""Messages without ROS have rclpy's defaults and bytes, and refuse what rclpy's assertions do."""

from __future__ import annotations

import math
from copy import copy
from importlib import import_module
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rclpy.serialization import deserialize_message
from rosbags.interfaces import Nodetype

from barc_sim.interfaces.definitions import installed
from barc_sim.ros.local import messages

if TYPE_CHECKING:
    from collections.abc import Iterator

TYPES = [
    *('barc_interfaces/ControllerState', 'barc_interfaces/ECU', 'barc_interfaces/PidState'),
    *('barc_interfaces/ZDynBkMdl', 'diagnostic_msgs/DiagnosticArray', 'geometry_msgs/Twist'),
    *('geometry_msgs/PoseWithCovarianceStamped', 'nav_msgs/Odometry', 'rcl_interfaces/Log'),
    *('rcl_interfaces/ParameterDescriptor', 'std_msgs/Empty'),
    *('sensor_msgs/Imu', 'sensor_msgs/Image', 'std_msgs/Float32MultiArray', 'std_msgs/Byte'),
    *('std_msgs/UInt8', 'visualization_msgs/Marker', 'rosgraph_msgs/Clock'),
]
_TEXT = st.text(st.characters(codec='utf-8', exclude_characters='\0'), max_size=5)
_BASES: dict[str, Any] = {
    'bool': st.booleans(),
    'byte': st.integers(0, 255).map(lambda value: bytes([value])),
    'string': _TEXT,
    'float32': st.floats(width=32, allow_nan=False),
    'float64': st.floats(allow_nan=False),
}


def both(name: str) -> tuple[type[Any], type[Any]]:
    package, _, short = name.partition('/')
    return getattr(import_module(f'{package}.msg'), short), messages.message_type(
        name.replace('/', '/msg/')
    )


def described(name: str) -> Iterator[tuple[str, bool, int, int, str]]:
    """Yield each field with whether it is of many, the least and most of them, and their type."""
    for field, (kind, node) in messages.store().fielddefs[name.replace('/', '/msg/')][1]:
        is_many = kind in (Nodetype.ARRAY, Nodetype.SEQUENCE)
        (kind_of_one, of), bound = node if is_many else ((kind, node), 0)
        base = of[0] if kind_of_one == Nodetype.BASE else of.replace('/msg/', '/')
        if field != 'structure_needs_at_least_one_member':
            yield field, is_many, bound * (kind == Nodetype.ARRAY), bound or 3, base


def values(name: str) -> st.SearchStrategy[dict[str, Any]]:
    """Return the values of a message's fields, by name; those of a message within are a dict."""

    def one(base: str) -> st.SearchStrategy[Any]:
        if '/' in base:
            return values(base)
        if base in _BASES:
            return _BASES[base]
        limits = np.iinfo({'char': 'uint8'}.get(base, base))
        return st.integers(int(limits.min), int(limits.max))

    return st.fixed_dictionaries(
        {
            field: st.lists(one(base), min_size=least, max_size=most) if is_many else one(base)
            for field, is_many, least, most, base in described(name)
        }
    )


def filled(name: str, given: dict[str, Any], which: int) -> Any:
    """Return a message of rclpy, or of ours, with the fields of `given`."""
    message = both(name)[which]()
    for field, is_many, _, _, base in described(name):
        made = given[field]
        if '/' in base:
            many = [filled(base, each, which) for each in (made if is_many else [made])]
            made = many if is_many else many[0]
        setattr(message, field, made)
    return message


@pytest.mark.parametrize('name', TYPES)
@settings(max_examples=25)
@given(data=st.data())
def test_rclpy_reads_our_serialized_messages(name: str, data: st.DataObject) -> None:
    theirs, ours = both(name)
    given = data.draw(values(name))
    of_ros, of_ours = filled(name, given, 0), filled(name, given, 1)
    # Not byte by byte: rclpy's padding is not always zero.
    assert repr(deserialize_message(of_ours.__serialize__(), theirs)) == repr(of_ros)
    assert ours.__copy__(of_ours) == of_ours


@pytest.mark.parametrize(
    'package', ['barc_interfaces', 'geometry_msgs', 'nav_msgs', 'rcl_interfaces', 'std_msgs']
)
def test_default_values_are_rclpys(package: str) -> None:
    for name in installed():
        of, kind, stem = name.split('/')
        if (of, kind) == (package, 'msg') and stem not in ('WString', 'Goals'):  # rosbags has none
            theirs, ours = both(f'{package}/{stem}')
            assert repr(theirs()) == repr(ours())


@pytest.mark.parametrize(
    ('name', 'field', 'value'),
    [
        ('barc_interfaces/ECU', 'motor', 1),
        ('barc_interfaces/ECU', 'header', 'road'),
        ('std_msgs/Byte', 'data', 1),
        ('barc_interfaces/ControllerState', 'names', ['a', 1]),
        ('barc_interfaces/ControllerState', 'names', 'kp'),
        ('barc_interfaces/ControllerState', 'values', [1]),
        ('rcl_interfaces/ParameterDescriptor', 'integer_range', [1]),
        ('geometry_msgs/PoseWithCovariance', 'covariance', [0.0]),
    ],
)
def test_publish_refuses_the_values_that_rclpy_refuses(
    name: str, field: str, value: object
) -> None:
    theirs, ours = both(name)
    with pytest.raises(AssertionError, match=f"'{field}'"):
        setattr(theirs(check_fields=True), field, value)
    with pytest.raises(AssertionError, match=f"'{field}'"):
        ours(**{field: value}).__copy__()


@pytest.mark.parametrize('which', [0, 1])
def test_a_bounded_sequence_holds_no_more_than_its_bound(which: int) -> None:
    message, item = (
        both(f'rcl_interfaces/{name}')[which] for name in ('ParameterDescriptor', 'IntegerRange')
    )
    options = {} if which else {'check_fields': True}
    with pytest.raises(AssertionError, match=r"'integer_range' .* <= 1"):
        copy(message(integer_range=[item(), item()], **options))


def test_a_float32_is_rounded_when_it_is_published() -> None:
    kind = messages.message_type('std_msgs/msg/Float32')
    assert kind.__copy__(kind(data=0.1)).data == pytest.approx(0.1, abs=1e-8)
    assert kind.__copy__(kind(data=0.1)).data != 0.1
    assert math.isinf(kind.__copy__(kind(data=math.inf)).data)
