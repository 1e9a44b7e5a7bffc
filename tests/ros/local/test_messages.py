"""Messages without ROS have rclpy's defaults and bytes, and refuse what rclpy's assertions do."""

from __future__ import annotations

import math
from importlib import import_module
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rclpy.serialization import deserialize_message

from barc_sim.bags.messages import share
from barc_sim.ros.local import messages

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


def values(kind: type[Any]) -> st.SearchStrategy[dict[str, Any]]:
    """Return the values of a message's fields, by name; those of a message within are a dict."""

    def value(field: Any) -> st.SearchStrategy[Any]:
        low, high = field.low, field.high
        if field.base in _BASES:
            one = _BASES[field.base]
        else:
            one = st.integers(low, high) if field.base else values(field.type)
        if not field.is_many:
            return one
        number = field.bound if field.fixed else 0
        return st.lists(one, min_size=number, max_size=number or field.bound or 3)

    return st.fixed_dictionaries({name: value(field) for name, field in kind.__fields__.items()})


def filled(message: Any, given: dict[str, Any], kind: type[Any], within: Any) -> Any:
    """Return the message with the fields of `given`; `within` makes those within it."""
    for name, value in given.items():
        field = kind.__fields__[name]
        made = value
        if not field.base:
            items = value if field.is_many else [value]
            many = [filled(within(field)(), each, field.type, within) for each in items]
            made = many if field.is_many else many[0]
        setattr(message, name, made)
    return message


@pytest.mark.parametrize('name', TYPES)
@settings(max_examples=25)
@given(data=st.data())
def test_rclpy_reads_what_is_written_here(name: str, data: st.DataObject) -> None:
    theirs, ours = both(name)
    given = data.draw(values(ours))
    of_ros = filled(
        theirs(), given, ours, lambda field: both(field.type.__msgtype__.replace('/msg/', '/'))[0]
    )
    of_ours = filled(ours(), given, ours, lambda field: field.type)
    # Not byte by byte: rclpy's padding is not always zero.
    assert repr(deserialize_message(of_ours.__serialize__(), theirs)) == repr(of_ros)
    assert ours.__copy__(of_ours) == of_ours


@pytest.mark.parametrize(
    'package', ['barc_interfaces', 'geometry_msgs', 'nav_msgs', 'rcl_interfaces', 'std_msgs']
)
def test_defaults_are_those_of_rclpy(package: str) -> None:
    for path in (share(package) / 'msg').glob('*.msg'):
        if path.stem not in ('WString', 'Goals'):  # rosbags has none
            theirs, ours = both(f'{package}/{path.stem}')
            assert repr(theirs()) == repr(ours())


@pytest.mark.parametrize(
    ('name', 'field', 'value'),
    [
        ('barc_interfaces/ECU', 'motor', 1),
        ('barc_interfaces/ECU', 'header', 'road'),
        ('std_msgs/UInt8', 'data', 256),
        ('std_msgs/Int8', 'data', -129),
        ('std_msgs/Byte', 'data', 1),
        ('barc_interfaces/ControllerState', 'names', ['a', 1]),
        ('barc_interfaces/ControllerState', 'names', 'kp'),
        ('barc_interfaces/ControllerState', 'values', [1]),
        ('rcl_interfaces/ParameterDescriptor', 'integer_range', [1]),
        ('geometry_msgs/PoseWithCovariance', 'covariance', [0.0]),
    ],
)
def test_what_rclpy_would_assert_is_refused_where_it_is_published(
    name: str, field: str, value: object
) -> None:
    theirs, ours = both(name)
    with pytest.raises(AssertionError, match=f"'{field}'"):
        setattr(theirs(check_fields=True), field, value)
    with pytest.raises(AssertionError, match=f"'{field}'"):
        ours(**{field: value}).__copy__()
    if value != 1:  # a whole number is recorded as a float
        with pytest.raises(AssertionError, match=f"'{field}'"):
            ours(**{field: value}).__serialize__()


def test_a_single_float_is_rounded_where_it_is_sent() -> None:
    kind = messages.message_type('std_msgs/msg/Float32')
    assert kind.__copy__(kind(data=0.1)).data == pytest.approx(0.1, abs=1e-8)
    assert kind.__copy__(kind(data=0.1)).data != 0.1
    assert math.isinf(kind.__copy__(kind(data=math.inf)).data)
