"""`barc identify`: what bags tell of their car, by our topics or by the fields of any."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

import numpy as np
import pytest
from command_line import printed, refused
from made_bags import make
from mcap.writer import Writer

from barc_sim import Vehicle, simulate
from barc_sim.control.excitation import PRBS

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from barc_sim import Log

pytest.importorskip('scipy')


@pytest.fixture(scope='module')
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the bag of a short drive with a delay of 0.1 s."""
    path = tmp_path_factory.mktemp('bags') / 'drive'
    log = simulate(controller=PRBS(), road='flat', distance=40.0, noise=0.02, delay=0.1)
    make(path, log, {'road': 'flat'})
    return path


def test_parameters_and_remarks_are_printed_and_drawn(bag: Path, tmp_path: Path) -> None:
    figure = tmp_path / 'prediction.png'
    lines = printed('identify', str(bag), '--save', str(figure))
    assert 'motor_delay ' in lines
    assert '- drag_per_mass cannot be identified' in lines
    assert figure.read_bytes().startswith(b'\x89PNG')


def test_processes_fit_the_resamples_of_a_bootstrap(bag: Path) -> None:
    words = ('identify', str(bag), '--bootstrap', '40')
    alone = printed(*words)
    assert printed(*words, '--jobs', '2') == alone
    assert alone != printed('identify', str(bag))


def test_fields_named_by_the_user_give_the_result_of_our_topics(bag: Path) -> None:
    """The times of reception stand in for the stamps."""
    fields = ['--field', 'v_x=/z_vhcl.v_x', '--field', 'motor=/ecu.motor']
    delays: list[float] = []
    for options in ([], fields):
        lines = map(str.split, printed('identify', str(bag), *options).splitlines())
        delays += [float(value) for name, value, *_ in lines if name == 'motor_delay']
    assert delays == pytest.approx([0.1, 0.1], abs=0.005)


@pytest.mark.parametrize(
    ('options', 'sentence'),
    [
        (['--jobs', '2'], '--jobs and --scheduler share the fits of --bootstrap: give it, too'),
        (['--bootstrap', '9'], '9 is not a whole number from 40 to'),
        (['--field', 'v_x'], "'v_x' must be a column and a field, as in v_x=/odom.twist.twist"),
        (['--field', 'v_x=/z_vhcl.v_x'], '--field names v_x: expected v_x and motor at least'),
        (
            ['--field', 'v_x=/z_vhcl.w', '--field', 'motor=/ecu.motor'],
            'has no numbers in this field; `barc convert` shows the fields of its topics',
        ),
        (
            ['--field', 'v_x=/a.b', '--field', 'motor=/ecu.motor', '--field', 'wheel=/c.d'],
            'wheel: a log has no such column; it has t, x, y',
        ),
        (['--save', 'figure.txt'], 'png'),
    ],
)
def test_fields_that_cannot_be_used_are_refused_in_one_sentence(
    bag: Path, options: list[str], sentence: str
) -> None:
    assert sentence in refused('identify', str(bag), *options)


def numbers_bag(
    folder: Path, log: Log, stamp: Callable[[float], float] = float, rows: slice = slice(None)
) -> Path:
    """Write the bag of another robot: topics with numbers, a command 2 ms after each speed."""
    path = folder / 'x_0.mcap'
    with path.open('wb') as file:
        writer = Writer(file)
        writer.start('ros2', '')
        schema = writer.register_schema('std_msgs/msg/Float64', 'ros2msg', b'float64 data\n')
        speed, accel = (
            writer.register_channel(topic, 'cdr', schema) for topic in ('/speed', '/accel')
        )
        for t, v_x, motor in list(zip(log.t, log.v_x, log.motor, strict=True))[rows]:
            for channel, late, value in ((speed, 0.0, v_x), (accel, 0.002, motor)):
                if np.isfinite(value):
                    received = int((1000.0 + stamp(t) + late) * 1e9)
                    data = b'\0\1\0\0' + np.float64(value).tobytes()
                    writer.add_message(channel, received, data, received)
        writer.finish()
    return path


FIELDS = ['--field', 'v_x=/speed.data', '--field', 'motor=/accel.data']


def test_commands_before_a_bag_begins_are_unknown(tmp_path: Path) -> None:
    """Its first 60 ms are missing: the car stands, but has a command already."""
    car = Vehicle(friction=300.0, air_drag_coeff=0.8)
    log = simulate(
        controller=PRBS(), road='flat', distance=80.0, noise=0.02, delay=0.13, vehicle=car
    )
    bag = numbers_bag(tmp_path, log, rows=slice(3, None))
    lines = dict(
        line.split(maxsplit=1) for line in printed('identify', str(bag), *FIELDS).splitlines()
    )
    friction, _, interval, *_ = lines['friction_per_mass'].split()
    assert abs(float(friction) - 0.15) < 2.0 * float(interval)

    delay, _, interval, *_ = lines['motor_delay'].split()
    assert abs(float(delay) - 0.128) < 2.0 * float(interval)


def test_a_clock_of_10_hz_is_refused(tmp_path: Path) -> None:
    """The times of reception repeat, and show no delay."""
    log = simulate(controller=PRBS(), road='flat', distance=30.0)
    bag = numbers_bag(tmp_path, log, stamp=lambda t: float(np.floor(10.0 * t) / 10.0))
    sentence = refused('identify', str(bag), *FIELDS)
    assert re.search(r'v_x=/speed.data: \d+ of \d+ messages share their time', sentence)
