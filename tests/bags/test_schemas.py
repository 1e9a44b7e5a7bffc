"""Definitions of messages and services, as a bag has them and as one reads them."""

from __future__ import annotations

import json
import re
from importlib.machinery import ModuleSpec
from typing import TYPE_CHECKING, Any

import pytest
from command_line import barc
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from barc_sim.bags import schemas
from barc_sim.bags.schemas import definition, definition_of, share
from barc_sim.bags.schemas import definition_lines as lines
from barc_sim.bags.schemas import find_type as find
from barc_sim.cli.process import has_ros
from barc_sim.errors import UserError

if TYPE_CHECKING:
    from pathlib import Path


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


ECU = """\
# Command to the vehicle's actuators.

std_msgs/Header header   # stamp: that of the state which this command answers
\tbuiltin_interfaces/Time stamp
\t\tint32 sec
\t\tuint32 nanosec
\tstring frame_id
float64 motor            # [m/s^2] acceleration along the direction of travel
float64 servo            # [rad] front steering angle, positive to the left
"""


@pytest.mark.parametrize('name', ['ECU', 'barc_interfaces/ECU', 'barc_interfaces/msg/ECU'])
def test_a_definition_is_printed_as_ros2_does(name: str) -> None:
    done = barc('show', name)

    assert (done.returncode, done.stdout, done.stderr) == (0, ECU, '')


def test_fields_of_the_same_package_are_expanded() -> None:
    assert '\tfloat64 x' in [*lines('geometry_msgs/msg/Twist')]


def test_without_ros_those_of_a_run_are_there(monkeypatch: pytest.MonkeyPatch) -> None:
    def missing(package: str) -> Path:
        raise LookupError(package)

    monkeypatch.setattr(schemas, 'share', missing)
    monkeypatch.delenv('AMENT_PREFIX_PATH', raising=False)

    assert '\n'.join([*lines(find('ECU')), '']) == ECU
    assert find('Twist') == 'geometry_msgs/msg/Twist'


def test_services_and_those_of_a_workspace_are_found(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / 'share' / 'my_msgs'
    for kind, text in (('msg', 'int32[<=3] a\nOther[] others\n'), ('srv', 'bool on\n---\n')):
        (folder / kind).mkdir(parents=True)
        (folder / kind / f'Switch.{kind}').write_text(text)
    (folder / 'msg' / 'Other.msg').write_text('# no\n\nstring<=5 name "x"  # no\nint8 A=1\n')
    monkeypatch.setenv('AMENT_PREFIX_PATH', str(tmp_path))

    assert [*lines(find('my_msgs/srv/Switch'))] == ['bool on', '---']
    assert [*lines('my_msgs/msg/Switch')] == [
        'int32[<=3] a', 'Other[] others', '\tstring<=5 name "x"', '\tint8 A=1',
    ]  # fmt: skip
    with pytest.raises(UserError, match='several types: name one of my_msgs/msg/Switch, my_msgs/s'):
        find('Switch')


@pytest.mark.parametrize(
    ('name', 'ends'),
    [
        ('ecu', ': did you mean ECU?'),
        ('barc_interfaces/Environmet', ': did you mean barc_interfaces/Environment'),
        ('zzzz', ': barc_interfaces has ControllerState, ECU, EZDynBkMdl'),
    ],
)
def test_a_wrong_name_is_one_sentence(name: str, ends: str) -> None:
    done = barc('show', name)

    assert done.returncode == 2
    assert f'there is no message or service {name!r}{ends}' in done.stderr


def test_what_stands_in_for_ros_does_not_hide_the_installed_definitions(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    pytest.importorskip('rclpy')
    monkeypatch.setattr('importlib.util.find_spec', lambda name: ModuleSpec(name, None))
    assert (schemas.share('sensor_msgs') / 'msg' / 'Imu.msg').is_file()
