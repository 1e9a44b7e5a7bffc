"""A run as arrays: shapes, and the truth behind noisy measurements."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import barc_sim
from barc_sim.control.speed import LQR
from barc_sim.errors import UserError
from barc_sim.simulation.closed_loop import closed_loop
from barc_sim.simulation.log import (
    COLUMNS,
    COMMAND,
    ENVIRONMENT,
    MESSAGE_TYPES,
    STATE,
    STATE_ERROR,
    Log,
    columns_of,
)
from barc_sim.vehicle.bike_model import Command, State
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
    plant.state = State(x=3.0, y=-4.0, psi=psi, v=5.0)
    true, seen = [], []
    for _ in range(len(log)):
        true.append(plant.state)
        seen.append(plant.observe())
        plant.advance(Command(1.0))
    measured = np.array([observation.measured for observation in seen]).T
    errors = np.array([observation.error for observation in seen]).T
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
    found = {}
    for topic, kind in MESSAGE_TYPES.items():
        text = (MSG / f'{kind.rpartition("/")[2]}.msg').read_text('utf-8')
        lines = re.findall(r'^(?:float64|bool) +(\w+) +# (?:\[(.*?)\])?', text, re.MULTILINE)
        found[topic] = {name: unit.replace('^2', '²') for name, unit in lines}
    return found


def test_columns_are_the_messages_fields_in_their_units() -> None:
    fields = messages()
    found = {(column.topic, column.field, column.unit) for column in COLUMNS.values()}
    for topic, field, unit in found:
        if topic:
            assert fields[topic][field] == unit, (topic, field)
    for topic in (STATE, STATE_ERROR, COMMAND, ENVIRONMENT):
        assert columns_of(topic).keys() == fields[topic].keys()


def test_frame_has_every_column_with_its_unit(log: Log) -> None:
    frame = log.to_frame()
    assert [*frame] == [*COLUMNS]
    np.testing.assert_array_equal(frame['motor'], log.motor)
    assert frame['saturated'].dtype == bool
    assert frame.attrs['units']['theta_deg'] == 'deg'


@pytest.mark.parametrize('controller', [None, LQR(output_min=-8.0, output_max=8.0)])
def test_a_saved_log_is_read_to_the_last_bit(tmp_path: Path, controller: LQR | None) -> None:
    log = closed_loop(controller=controller, max_duration=1.0)
    log.save(tmp_path / 'run')
    again = Log.read(tmp_path / 'run')
    assert again == log
    for ours, theirs in zip(again.columns().values(), log.columns().values(), strict=True):
        assert (ours.tobytes(), ours.dtype) == (theirs.tobytes(), theirs.dtype)


def test_logs_are_equal_by_their_values(log: Log) -> None:
    assert log == closed_loop(max_duration=1.0)
    assert log != closed_loop(max_duration=0.98)
    assert log != replace(log, motor=np.nextafter(log.motor, 9.0))
    assert log != replace(log, own_terms={'feedback': log.motor})
    assert log != 'log'


def test_a_file_that_is_no_log_is_refused(tmp_path: Path, log: Log) -> None:
    file = tmp_path / 'run.npz'
    for write in (
        lambda: file.write_bytes(b'no archive'),
        lambda: np.savez(file, t=log.t),
        lambda: np.savez(file, **{name: np.array([None]) for name in COLUMNS}),
        lambda: np.savez(file, **(dict(log.columns()) | {'t': log.t[1:]})),
    ):
        write()
        with pytest.raises(UserError, match=r"run.npz' is no log of Log.save: "):
            Log.read(file)


def test_a_file_that_unpacks_to_too_much_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    np.savez_compressed(tmp_path / 'run.npz', **{name: np.zeros(5000) for name in COLUMNS})
    monkeypatch.setattr('barc_sim.simulation.log._MAX_SIZE', 100_000)
    with pytest.raises(UserError, match='it holds more than 100000 bytes'):
        Log.read(tmp_path / 'run.npz')
