"""A run as arrays: shapes, and the truth behind noisy measurements."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import barc_sim
from barc_sim.control.speed import LQR
from barc_sim.interfaces.records import Command
from barc_sim.interfaces.topics import ECU, ENVIRONMENT, LOG_TYPES, STATE, STATE_ERROR
from barc_sim.simulation.closed_loop import closed_loop, lap, simulate
from barc_sim.simulation.log import COLUMNS, Log, columns_of
from barc_sim.vehicle.bike_model import BicycleState
from barc_sim.vehicle.plant import NoiseLevels, Plant
from barc_sim.vehicle.road import Road

MSG = Path(barc_sim.__file__).parents[1] / 'barc_interfaces/msg'


@pytest.fixture(scope='module')
def log() -> Log:
    return closed_loop(max_duration=1.0)


@pytest.mark.parametrize('name', ['x', 'missed', 'saturated'])
def test_array_of_another_length_is_refused_by_name(log: Log, name: str) -> None:
    with pytest.raises(ValueError, match=rf'^{name} has shape \(50,\), expected \(51,\)$'):
        replace(log, **{name: getattr(log, name)[1:]})


@pytest.mark.parametrize('psi', [0.0, 0.5, 2.0, -3.0])
def test_distance_and_speed_are_the_true_ones_behind_the_noise(log: Log, psi: float) -> None:
    plant = Plant(
        road=Road.flat(), noise=NoiseLevels(s=2.0, ey=3.0, epsi=0.4, v_x=0.5, v_y=1.0, psi_dot=1.0)
    )
    plant.state = BicycleState(x=3.0, y=-4.0, psi=psi, v=5.0)
    true, observed = [], []
    for _ in range(len(log)):
        true.append(plant.state)
        observed.append(plant.observe())
        plant.advance(Command(1.0))
    measured = np.array([observation.measured for observation in observed]).T
    errors = np.array([observation.error for observation in observed]).T
    noisy = replace(
        log,
        **dict(zip(('x', 'y', 'psi', 'v_x', 'v_y', 'psi_dot'), measured, strict=True)),
        **dict(zip(('e_s', 'e_ey', 'e_epsi', 'e_v_x', 'e_v_y', 'e_psi_dot'), errors, strict=True)),
    )

    assert np.abs(noisy.x - [state.x for state in true]).max() > 1.0
    assert noisy.distance == pytest.approx(np.array([state.x for state in true]), abs=1e-12)
    assert noisy.speed == pytest.approx(np.array([state.v for state in true]), abs=1e-12)


# One declaration


def messages() -> dict[str, dict[str, str]]:
    """Return, by topic, the units of the fields as the .msg files have them in their comments."""
    by_topic = {}
    for topic, kind in LOG_TYPES.items():
        text = (MSG / f'{kind.rpartition("/")[2]}.msg').read_text('utf-8')
        lines = re.findall(r'^(?:float64|bool) +(\w+) +# (?:\[(.*?)\])?', text, re.MULTILINE)
        by_topic[topic] = {name: unit.replace('^2', '²') for name, unit in lines}
    return by_topic


def test_each_column_has_the_unit_of_its_field_in_the_message() -> None:
    fields = messages()
    described = {(column.topic, column.field, column.unit) for column in COLUMNS.values()}
    for topic, field, unit in described:
        if topic:
            assert fields[topic][field] == unit, (topic, field)
    for topic in (STATE, STATE_ERROR, ECU, ENVIRONMENT):
        assert columns_of(topic).keys() == fields[topic].keys()


def test_frame_has_every_column_with_its_unit(log: Log) -> None:
    frame = log.to_frame()
    assert [*frame] == [*COLUMNS]
    np.testing.assert_array_equal(frame['motor'], log.motor)
    assert frame['saturated'].dtype == bool
    assert frame.attrs['units']['theta_deg'] == 'deg'


def test_logs_with_equal_values_are_equal(log: Log) -> None:
    assert log == closed_loop(max_duration=1.0)
    assert log != closed_loop(max_duration=0.98)
    assert log != replace(log, motor=np.nextafter(log.motor, 9.0))
    assert log != replace(log, own_terms={'feedback': log.motor})
    assert log != 'log'


def test_a_log_can_be_made_again_from_its_columns() -> None:
    """Also where a controller has terms of its own."""
    logs = (
        closed_loop(max_duration=1.0),
        simulate(controller=LQR(), distance=5.0),
        lap(laps=1),
    )
    for log in logs:
        assert type(log)(**log.columns()) == log

    log = logs[1]
    assert log.own_terms
    again = Log(**log.columns() | {'own_terms': {'more': log.t}})
    assert again.own_terms.keys() == {*log.own_terms, 'more'}
