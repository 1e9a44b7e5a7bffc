"""What `identify.py` prints of the drives among its bags."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

import pytest
from made_bags import make

from barc_sim.lab.own_estimate import print_estimate
from barc_sim.simulation.closed_loop import simulate

if TYPE_CHECKING:
    from pathlib import Path

SIX = [2e-4, 1e-6, 0.08, 1e-4, 0.1, 1e-3]


def bag(path: Path, part: str) -> str:
    """Make a bag of a drive with a file of a part."""
    code = json.dumps({'files': {part: f'{part}.py'}, 'sha256': {}})
    return str(make(path, simulate(distance=1.0), {'student_code': code}))


def test_the_six_numbers_have_names_and_units(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    own = bag(tmp_path / 'own', 'identify')
    others = [bag(tmp_path / 'lane', 'lane'), str(tmp_path / 'nothing')]
    print_estimate(lambda t, _, __: SIX if len(t) > 1 else [], [own, *others])
    assert capsys.readouterr().out.splitlines() == [
        own,
        'drag      0.0002 ± 1e-06 1/m',
        'friction  0.08 ± 0.0001 m/s²',
        'delay     0.1 ± 0.001 s',
    ]


def test_bags_of_other_labs_are_refused(tmp_path: Path) -> None:
    bags = [bag(tmp_path / 'lane', 'lane')]
    sentence = 'none of 1 bags is one of a drive with an identify.py: drive with barc acc --road'
    with pytest.raises(SystemExit, match=sentence):
        print_estimate(lambda *_: SIX, bags)


def test_without_a_bag_the_command_of_the_drive_is_named() -> None:
    with pytest.raises(SystemExit, match=r'none of 0 bags .* drive with barc acc --road flat'):
        print_estimate(lambda *_: SIX, [])


def test_another_number_of_results_is_named(tmp_path: Path) -> None:
    with pytest.raises(SystemExit, match='estimate returned 3 numbers: expected six finite'):
        print_estimate(lambda *_: SIX[:3], [bag(tmp_path / 'own', 'identify')])
