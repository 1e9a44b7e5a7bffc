"""Bags made of logs, without ROS."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

import numpy as np
import yaml
from rosbags.interfaces import Nodetype
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from barc_sim.bags.messages import BagMessage, Topic, topic
from barc_sim.bags.writer import BagWriter
from barc_sim.control.lane import LANE
from barc_sim.control.speed import PID
from barc_sim.interfaces.definitions import definition
from barc_sim.interfaces.topics import CONTROLLER_STATE, LANE_STATE, LOG_TYPES, PID_STATE
from barc_sim.simulation.log import columns_of
from barc_sim.simulation.stepper import parameters as simulator_parameters

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from barc_sim.simulation.log import Log

PERIOD = 20_000_000
TYPES = get_typestore(Stores.EMPTY)
for _name in LOG_TYPES.values():
    TYPES.register(get_types_from_msg(definition(_name), _name))
(QOS,) = topic('/clock', 'rosgraph_msgs/msg/Clock').offered_qos
#: A topic of one number.
VALUE = Topic(
    name='/value',
    type='std_msgs/msg/Float64',
    definition='float64 data\n',
    type_hash='RIHS01_705ba9c3d1a09df43737eb67095534de36fd426c0587779bda2bc51fe790182a',
    offered_qos=[QOS],
)
GRAPH = json.dumps(
    {
        'nodes': ['/controller', '/vehicle_simulator'],
        'topics': {'/ecu': 'barc_interfaces/msg/ECU', '/z_vhcl': 'barc_interfaces/msg/ZDynBkMdl'},
        'publications': [['/controller', '/ecu'], ['/vehicle_simulator', '/z_vhcl']],
        'subscriptions': [['/ecu', '/vehicle_simulator'], ['/z_vhcl', '/controller']],
    }
)
SIMULATOR = {each.name: each.default for each in simulator_parameters()}
CONTROLLER: dict[str, Any] = {
    'kp': 30.0,
    'ki': 200.0,
    'kd': 0.1,
    'speed_reference': 8.0,
    'acceleration_limit': 8.0,
}


#: The parameters of a run, as its bag has them.
PARAMETERS = yaml.safe_dump(
    {
        '/vehicle_simulator': {'ros__parameters': SIMULATOR},
        '/controller': {'ros__parameters': CONTROLLER},
    }
)


#: The description of a field with a number.
_NUMBER = (Nodetype.BASE, ('float64', 0))


def encoded(log: Log, k: int, topic: str) -> bytes:
    """Return the message of a topic that belongs to state `k`, in CDR."""
    name, types = LOG_TYPES[topic], TYPES
    sec, nanosec = divmod(10**18 + k * PERIOD, 10**9)
    stamp = types.types['builtin_interfaces/msg/Time'](sec=sec, nanosec=nanosec)
    source = PID_STATE if topic == CONTROLLER_STATE else topic
    # A field that a log has no column for is zero.
    _, described = types.fielddefs[name]
    values: dict[str, Any] = {field: 0.0 for field, kind in described if kind == _NUMBER}
    for field, column in columns_of(source).items():
        values[field] = getattr(log, column)[k].item()
    if 'lap' in values:
        values['lap'] = int(values['lap'])
    if topic == LANE_STATE:
        lane_terms = {name: each for name, each in log.own_terms.items() if name.startswith(LANE)}
        values['names'] = [name.removeprefix(LANE) for name in lane_terms]
        values['values'] = np.array([each[k] for each in lane_terms.values()])
    if topic == CONTROLLER_STATE:
        values = {field: value for field, value in values.items() if field not in PID.terms} | {
            'names': [*log.terms],
            'values': np.array([term[k] for term in log.terms.values()]),
        }
    header = types.types['std_msgs/msg/Header'](stamp=stamp, frame_id='')
    return bytes(types.serialize_cdr(types.types[name](header=header, **values), name))


def fill(writer: BagWriter, log: Log, namespace: str = '') -> None:
    """Write the messages of a log as the recorder does, in chunks."""
    unused = CONTROLLER_STATE if log.terms.keys() == PID.terms.keys() else PID_STATE
    topics = {
        name: topic(f'{namespace}/{name}', kind)
        for name, kind in LOG_TYPES.items()
        if name != unused and {*columns_of(name).values()} <= log.declared.keys()
    }
    for k in range(len(log)):
        now = 10**18 + k * PERIOD
        for name, each in topics.items():
            data = encoded(log, k, name)
            writer.write([BagMessage(each, data, now + 5, now, k)])
        if k % 8 == 0:
            writer.flush()


def make(
    directory: Path,
    log: Log,
    metadata: Mapping[str, str] | None = None,
    attachments: Mapping[str, bytes] | None = None,
) -> Path:
    """Make the bag of a run; return its directory."""
    directory.mkdir()
    writer = BagWriter(
        directory, metadata={'parameters': PARAMETERS, 'graph': GRAPH} | dict(metadata or {})
    )
    writer.attach(attachments or {})
    fill(writer, log)
    writer.close()
    return directory
