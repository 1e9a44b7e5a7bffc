"""The parameters of nodes over time, from metadata and events."""

from __future__ import annotations

from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
import yaml
from made_bags import PERIOD, QOS, make

from barc_sim.bags import bounds
from barc_sim.bags import reader as bag
from barc_sim.bags.messages import BagMessage, Topic
from barc_sim.bags.parameters import EVENT_TYPE, ParameterHistory
from barc_sim.bags.writer import BagWriter
from barc_sim.interfaces.definitions import definition, store
from barc_sim.interfaces.topics import PARAMETER_EVENTS
from barc_sim.simulation.closed_loop import closed_loop

if TYPE_CHECKING:
    from pathlib import Path

START = 10**18  #: [ns] of the first state of a made bag
INTEGER, DOUBLE, TEXT = 2, 3, 4


def event(node: str, values: dict[str, float | int | str], published: int = 0) -> BagMessage:
    """Return the message of a node whose parameters were changed to these values."""
    types = store().types
    fields = {float: (DOUBLE, 'double_value'), int: (INTEGER, 'integer_value')}
    changed = []
    for name, value in values.items():
        kind, field = fields.get(type(value), (TEXT, 'string_value'))
        empty: dict[str, Any] = {
            'bool_value': False, 'integer_value': 0, 'double_value': 0.0, 'string_value': '',
            'byte_array_value': np.array([], np.uint8), 'bool_array_value': np.array([], np.bool_),
            'integer_array_value': np.array([], np.int64),
            'double_array_value': np.array([], np.float64), 'string_array_value': [],
        }  # fmt: skip
        of = types['rcl_interfaces/msg/ParameterValue'](type=kind, **empty | {field: value})
        changed.append(types['rcl_interfaces/msg/Parameter'](name=name, value=of))
    message = types[EVENT_TYPE](
        stamp=types['builtin_interfaces/msg/Time'](sec=0, nanosec=0),
        node=node,
        new_parameters=[],
        changed_parameters=changed,
        deleted_parameters=[],
    )
    topic = Topic(
        name=PARAMETER_EVENTS,
        type=EVENT_TYPE,
        definition=definition(EVENT_TYPE),
        type_hash='',
        offered_qos=[QOS],
    )
    return BagMessage(
        topic, bytes(store().serialize_cdr(message, EVENT_TYPE)), published, published, 1
    )


def described(**nodes: dict[str, object]) -> str:
    return yaml.safe_dump({f'/{node}': {'ros__parameters': of} for node, of in nodes.items()})


def decoded(message: BagMessage) -> Any:  # noqa: ANN401 (a ParameterEvent)
    return store().deserialize_cdr(message.data, EVENT_TYPE)


def test_a_parameter_has_its_value_from_each_change_on() -> None:
    history = ParameterHistory(described(controller={'kp': 2.0, 'n': 3, 'on': True, 'name': 'x'}))
    history.add(decoded(event('/controller', {'kp': 9.0})), 300)
    history.add(decoded(event('/controller', {'kp': 4.0, 'name': 'y', 'late': 1})), 200)
    history.add(decoded(event('/car2/controller', {'kp': 7.0})), 0)
    columns = history.columns('/controller', np.array([0, 199, 200, 299, 300, 10**18], np.uint64))
    assert columns['kp'].tolist() == [2.0, 2.0, 4.0, 4.0, 9.0, 9.0]
    assert columns['n'].tolist() == [3.0] * 6
    np.testing.assert_array_equal(columns['late'], [np.nan, np.nan, 1.0, 1.0, 1.0, 1.0])
    assert columns.keys() == {'kp', 'n', 'late'}
    assert not history.columns('/missing', np.array([0], np.uint64))


@pytest.mark.parametrize(
    'text',
    [
        '[',
        '- a',
        '/controller: 3',
        '/controller: {ros__parameters: [kp]}',
        '&a [*a, *a]',
        '[' * 9999,
    ],
)
def test_a_description_of_something_else_is_left_out(text: str) -> None:
    assert not ParameterHistory(text).columns('/controller', np.array([0], np.uint64))


def test_an_integer_beyond_all_floats_is_left_out() -> None:
    text = '/controller: {ros__parameters: {kp: 1' + '0' * 350 + ', ki: 2.0}}'
    columns = ParameterHistory(text).columns('/controller', np.array([0], np.uint64))
    assert columns.keys() == {'ki'}


def test_more_parameters_than_nodes_have_are_refused() -> None:
    history = ParameterHistory()
    names = SimpleNamespace(type=DOUBLE, double_value=1.0)
    many = [SimpleNamespace(name=f'{k}', value=names) for k in range(bounds.MAX_PARAMETERS + 1)]
    with pytest.raises(ValueError, match='parameters'):
        history.add(SimpleNamespace(node='/a', new_parameters=many, changed_parameters=[]), 0)


def with_events(directory: Path, *events: BagMessage) -> Path:
    """Return the bag of a short run with events."""
    log = closed_loop(distance=5.0)
    make(directory, log)
    extra = directory.with_name('events')
    extra.mkdir()
    writer = BagWriter(extra)
    writer.write(events)
    writer.close()
    (extra / writer.file.name).rename(directory / f'{directory.name}_1.mcap')
    return directory


def test_a_log_has_the_parameters_with_which_each_state_was_answered(tmp_path: Path) -> None:
    """A made bag's messages of state k are all published at its time."""
    changed = [
        event('/controller', {'kp': 2.0, 'own': 1.5}, START + 10 * PERIOD - 1),
        event('/vehicle_simulator', {'noise_v_x': 0.1, 'mass': 3.0}, START + 20 * PERIOD - 1),
        event('/car2/controller', {'kp': 7.0}, START),
    ]
    log = bag.read(with_events(tmp_path / 'run', *changed))
    assert set(log.parameters['controller.kp'][:10]) == {30.0}
    assert set(log.parameters['controller.kp'][10:]) == {2.0}
    assert np.isnan(log.parameters['controller.own'][:10]).all()
    assert set(log.parameters['controller.own'][10:]) == {1.5}
    assert set(log.parameters['vehicle_simulator.noise_v_x'][:20]) == {0.0}
    assert set(log.parameters['vehicle_simulator.noise_v_x'][20:]) == {0.1}
    assert 'vehicle_simulator.mass' not in log.parameters  # cannot be changed
    assert {*log.parameters} <= {*log.to_frame()}
    half = log.map(lambda column: column[10:])
    assert set(half.parameters['controller.kp']) == {2.0}


def test_events_that_cannot_be_decoded_cost_the_run_nothing(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    whole = event('/controller', {'kp': 2.0}, START)
    other = Topic(
        name=PARAMETER_EVENTS,
        type=EVENT_TYPE,
        definition='float64 node\n',
        type_hash='',
        offered_qos=[QOS],
    )
    for k, message in enumerate(
        [whole._replace(data=whole.data[:30]), whole._replace(topic=other)]
    ):
        (tmp_path / f'{k}').mkdir()
        log = bag.read(with_events(tmp_path / f'{k}' / 'run', message))
        assert set(log.parameters['controller.kp']) == {30.0}
    assert sum('cannot be decoded' in record.getMessage() for record in caplog.records) == 2
