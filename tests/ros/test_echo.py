"""Messages as text, and their rate in words."""

from __future__ import annotations

import pytest

pytest.importorskip('rclpy')

from barc_interfaces.msg import ECU
from std_msgs.msg import Float64MultiArray, MultiArrayDimension, String

from barc_sim.errors import UserError
from barc_sim.ros.introspection import describe_rate, field_of, to_yaml

LONG = Float64MultiArray(data=[float(i) for i in range(200)])


def test_field_order_is_that_of_the_definition() -> None:
    assert to_yaml(ECU(motor=1e-7, servo=float('nan'))) == (
        "header:\n  stamp:\n    sec: 0\n    nanosec: 0\n  frame_id: ''\n"
        'motor: 1.0e-07\nservo: .nan\n'
    )


def test_long_arrays_and_strings_are_cut_unless_asked_otherwise() -> None:
    assert to_yaml(LONG).count('\n- ') == 129
    assert to_yaml(LONG, None).count('\n- ') == 200
    assert to_yaml(String(data='x' * 200), 3) == 'data: xxx...\n'


def test_field_may_be_an_element() -> None:
    message = Float64MultiArray()
    message.layout.dim = [MultiArrayDimension(label='a'), MultiArrayDimension(label='b')]
    assert field_of(message, 'layout.dim.1.label') == 'b'
    with pytest.raises(UserError, match=r"no field 'layout\.dim\.2': '2' is not an index below 2"):
        field_of(message, 'layout.dim.2')


def test_same_as_rosidl_runtime_py() -> None:
    theirs = pytest.importorskip('rosidl_runtime_py', reason='comes with an installed ROS only')
    fixtures = pytest.importorskip('test_msgs.message_fixtures')
    for name in ('Arrays', 'BasicTypes', 'BoundedSequences', 'MultiNested', 'WStrings'):
        for message in fixtures.get_test_msg(name):
            for length in (128, 2, None):
                assert to_yaml(message, length) == theirs.message_to_yaml(
                    message, truncate_length=length
                )


@pytest.mark.parametrize(
    ('times', 'words'),
    [
        ([], 'no message'),
        ([5], '1 message'),
        (
            [0, 10_000_000, 30_000_000],
            'average rate: 66.667 min: 0.010s max: 0.020s std dev: 0.00500s window: 2',
        ),
        ([5, 5], 'average rate: 0.000 min: 0.000s max: 0.000s std dev: 0.00000s window: 1'),
    ],
)
def test_rate_is_printed_as_by_ros2_topic_hz(times: list[int], words: str) -> None:
    assert describe_rate(times) == words
