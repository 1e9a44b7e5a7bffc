"""`barc identify`: what bags tell of their car, by our topics or by the fields of any."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest
from command_line import printed, refused
from made_bags import make

from barc_sim import simulate
from barc_sim.control.excitation import PRBS

if TYPE_CHECKING:
    from pathlib import Path

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


def test_fields_by_name_give_what_our_topics_give(bag: Path) -> None:
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
def test_what_cannot_be_read_is_one_sentence(bag: Path, options: list[str], sentence: str) -> None:
    assert sentence in refused('identify', str(bag), *options)
