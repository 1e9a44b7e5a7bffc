"""The bags of both engines are the same, but for what says who published."""

from __future__ import annotations

from argparse import Namespace
from contextlib import nullcontext
from typing import TYPE_CHECKING, Any, NamedTuple

import pytest

pytest.importorskip('rclpy')

from command_line import call
from geometry_msgs.msg import Twist, Vector3
from mcap.reader import make_reader
from rclpy.node import Node
from rosbags.highlevel import AnyReader

from barc_sim.bags.cdr import leading_time
from barc_sim.bags.reader import info
from barc_sim.bags.recording import Recording
from barc_sim.control.driver import Driver, DriverInput
from barc_sim.ros.process import ros
from barc_sim.runs.local.driving import DriverTopic
from barc_sim.runs.local.engine import LocalEngine
from barc_sim.runs.ros_engine import RosEngine
from barc_sim.vehicle.bike_model import bikeFE
from barc_sim.vehicle.road import Road

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from barc_sim.vehicle.plant import Observation

#: Their messages name the node, the folder of the bag and the line of code.
WORDS = {'/rosout', '/parameter_events'}


class Topic(NamedTuple):
    """What a bag holds of a topic, with stamps [ns] from the first one on."""

    type: str
    schema: bytes
    metadata: dict[str, str]
    sequences: list[int]
    messages: list[Any]


def topics(bags: Path) -> dict[str, Topic]:
    (file,) = bags.rglob('*.mcap')
    found: dict[str, Topic] = {}
    with file.open('rb') as stream, AnyReader([file.parent]) as reader:
        first, repeated = {}, 0
        for schema, channel, message in make_reader(stream).iter_messages():
            assert schema
            topic = found.setdefault(
                channel.topic, Topic(schema.name, schema.data, channel.metadata, [], [])
            )
            stamp = leading_time(message.data)
            since = stamp - first.setdefault(channel.topic, stamp)
            # Bytes between the fields are what ROS found in memory: it is read for comparison.
            values = reader.deserialize(message.data, schema.name)
            for field in ('header', 'stamp', 'clock'):
                if hasattr(values, field):
                    object.__setattr__(values, field, since)
            # On a busy machine, ROS names nodes that it waits for, and repeats the clock for them.
            if 'waiting for' in getattr(values, 'msg', ''):
                continue
            if channel.topic == '/clock' and repr(values) in topic.messages[-1:]:
                repeated += 1
                continue
            topic.sequences.append(message.sequence - repeated * (channel.topic == '/clock'))
            topic.messages.append(None if channel.topic in WORDS else repr(values))
    return found


#: Puts the speed where the position is wanted.
STUCK = """
from barc_sim.vehicle import bike_model


def bikeFE(*state_and_input):
    x, y, psi, v = bike_model.bikeFE(*state_and_input)
    return [v, y, psi, v]
"""


@pytest.mark.usefixtures('ros_domain')
@pytest.mark.parametrize(
    ('local_factor', 'options'),
    [
        ('max', ('--distance', '30')),
        ('20', ('--distance', '10')),
        ('max', ('--distance', '10', '--controller-type', 'lqr')),
    ],
    ids=['lock-step', 'paced', 'another controller'],
)
def test_bags_are_equal(tmp_path: Path, local_factor: str, options: tuple[str, ...]) -> None:
    found = {}
    for engine, factor in (('ros', 'max'), ('local', local_factor)):
        bags = tmp_path / engine
        words = ('--engine', engine, '--realtime-factor', factor, '--bag-dir', str(bags))
        done = call('acc', *words, *options)
        assert (done.returncode, done.stdout.splitlines()[0].split()[0]) == (0, 'engine')
        found[engine] = topics(bags)
    assert found['local'].keys() == found['ros'].keys() >= {'/z_vhcl', '/ecu', '/rosout'}
    for name, topic in found['ros'].items():
        assert found['local'][name] == topic, name


@pytest.mark.usefixtures('ros_domain')
def test_a_car_that_never_arrives_ends_both_in_the_same_state(tmp_path: Path) -> None:
    (tmp_path / 'bike_model.py').write_text(STUCK)
    found = []
    for engine in ('ros', 'local'):
        bags = tmp_path / engine
        words = ('--engine', engine, '--realtime-factor', 'max', '--bag-dir', str(bags))
        done = call('acc', *words, '--model', str(tmp_path / 'bike_model.py'))
        sentence = 'the car stands at 8.0 m: the model returns the speed in place of x; it got no'
        assert (done.returncode, sentence in done.stderr) == (1, True)
        (bag,) = bags.iterdir()
        assert info(bag)['failure'] in done.stderr
        found.append(topics(bags)['/z_vhcl'])
    assert found[0] == found[1]
    assert len(found[0].messages) > 1000


#: Of a drive by hand: from so many seconds on, what is requested.
DRIVE = {
    0.0: DriverInput(forward=1.0),
    0.1: DriverInput(forward=1.0, turn=0.5),
    0.24: DriverInput(forward=0.5, turn=-0.25),
    0.4: DriverInput(forward=-1.0, turn=0.125),
    0.5: DriverInput(brake=1.0),
}
END = 0.6  # [s]


def publisher(engine: RosEngine | LocalEngine, relay: Any) -> Callable[[DriverInput], None]:  # noqa: ANN401 (of the engine)
    """Return what publishes on `cmd_vel`, as the node `player`."""
    if isinstance(engine, LocalEngine):
        host = engine._host  # noqa: SLF001
        return DriverTopic(host, host.node('player').name, relay).publish
    twists = engine.add(Node('player')).create_publisher(Twist, 'cmd_vel', 10)

    def publish(request: DriverInput) -> None:
        linear = Vector3(x=request.forward, z=-request.brake or 0.0)
        twists.publish(Twist(linear=linear, angular=Vector3(z=request.turn)))

    return publish


def replay(engine: RosEngine | LocalEngine, drive: dict[float, DriverInput], bags: Path) -> Path:
    """Drive by hand as `drive` does, one step for each command; return the bag."""
    waiting = sorted(drive.items())

    def on_step(t: float, _: Observation) -> None:
        while waiting and waiting[0][0] <= t + 1e-9:
            publish(waiting.pop(0)[1])
        if t >= END - 1e-9:
            simulator.stepper.end()

    recorder = engine.recorder(bags, Recording(), {}, {})
    # A stall of the machine for less than `dt` changes no order.
    relay = engine.relay(Driver(dt=0.1), {'stale_after': 60.0})
    road, given = Road.flat(), {'realtime_factor': 0.0}
    simulator = engine.simulator(road=road, on_step=on_step, model=bikeFE, given=given)
    publish = publisher(engine, relay)
    engine.show(Namespace(view='none', quiet=True))
    engine.spin()
    engine.close()
    return recorder.path


def recorded(bag: Path) -> dict[float, DriverInput]:
    """Return the requests on `cmd_vel` of a bag, at times [s] from the first state on."""
    found, start = {}, None
    with AnyReader([bag]) as reader:
        for connection, stamp, data in reader.messages():
            if connection.topic == '/z_vhcl':
                start = start or stamp
            elif connection.topic == '/cmd_vel' and start:
                twist: Any = reader.deserialize(data, connection.msgtype)
                request = DriverInput(twist.linear.x, twist.angular.z, -twist.linear.z)
                found[(stamp - start) / 1e9] = request
    return found


@pytest.mark.slow
@pytest.mark.usefixtures('ros_domain')
def test_recorded_requests_drive_both_alike(tmp_path: Path) -> None:
    drive = recorded(replay(LocalEngine([]), DRIVE, tmp_path / 'recorded'))
    assert list(drive) == pytest.approx(list(DRIVE))
    assert list(drive.values()) == list(DRIVE.values())
    found, commands = {}, {}
    for name, started in (('ros', ros([])), ('local', nullcontext())):
        with started:
            bag = replay(RosEngine() if name == 'ros' else LocalEngine([]), drive, tmp_path / name)
        found[name] = topics(bag)
        # The relay commands before the run begins, too: for as long as the nodes take.
        states = len(found[name]['/z_vhcl'].messages)
        ecu = found[name]['/ecu']
        commands[name] = ecu.messages[-states:]
        found[name]['/ecu'] = ecu._replace(sequences=[], messages=[])
    assert states == round(END / 0.02) + 1
    assert found['local'].keys() == found['ros'].keys() >= {'/cmd_vel', '/ecu', '/z_vhcl'}
    for topic, messages in found['ros'].items():
        assert found['local'][topic] == messages, topic
    assert commands['local'] == commands['ros']
    assert len(set(commands['local'])) > len(DRIVE)
