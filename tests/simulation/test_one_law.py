"""Each law stands in one place: a change of its function changes every part of the program.

A copy of the package with one line changed runs the parts, and so do the sources as they are, with
a parameter that has the same effect as the changed line.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import pytest

import barc_sim

pytest.importorskip('gymnasium')

if TYPE_CHECKING:
    from collections.abc import Sequence

PACKAGE = Path(barc_sim.__file__).parent
PROGRAM = Path(__file__).with_name('one_law.py')
FRICTION, LAG = 0.01711, 0.1
#: The judge's car is the usual one: no parameter changes it.
WITH_PARAMETERS = ['node', 'simulate', 'sweep', 'environment', 'batch', 'identification']
pytestmark = pytest.mark.slow


class Change(NamedTuple):
    """A change of one line of a law, and what it changes."""

    file: str
    line: str
    changed: str
    parts: Sequence[str]  #: of the program that step the car by this law
    friction: float = FRICTION  #: [N] and
    lag: float = LAG  #: [s] with the same effect


CHANGES = {
    'resistance': Change(
        'vehicle/bike_model.py',
        'return vehicle.air_drag_coeff * v * v + vehicle.friction',
        'return vehicle.air_drag_coeff * v * v + vehicle.friction + 5.0',
        [*WITH_PARAMETERS, 'judge'],
        friction=FRICTION + 5.0,
    ),
    'lag': Change(
        'vehicle/plant.py',
        'lag = actuator.lag',
        'lag = 2.0 * actuator.lag',
        [*WITH_PARAMETERS, 'judge'],
        lag=2.0 * LAG,
    ),
    'steering': Change(
        'control/lane.py',
        'return LaneTerms(feedforward, -k1 * e_y,',
        'return LaneTerms(feedforward, +k1 * e_y,',
        ['node', 'simulate', 'sweep', 'judge'],
    ),
}


def figures(
    folder: Path, package: Path, friction: float = FRICTION, lag: float = LAG
) -> dict[str, list[float]]:
    """Return the figures of each part, of a package."""
    folder.mkdir()
    process = subprocess.run(
        [sys.executable, str(PROGRAM), str(friction), str(lag)],
        cwd=folder,
        env=os.environ | {'PYTHONPATH': str(package.parent), 'XDG_CACHE_HOME': str(folder)},
        capture_output=True,
        text=True,
        timeout=300.0,
        check=False,
    )
    assert process.returncode == 0, process.stderr
    by_part: dict[str, list[float]] = json.loads(process.stdout)
    return by_part


@pytest.fixture(scope='module')
def usual(tmp_path_factory: pytest.TempPathFactory) -> dict[str, list[float]]:
    """Return the figures of the sources as they are."""
    return figures(tmp_path_factory.mktemp('usual') / 'run', PACKAGE)


@pytest.mark.parametrize('name', CHANGES)
def test_a_change_of_a_law_changes_every_part(
    name: str, usual: dict[str, list[float]], tmp_path: Path
) -> None:
    change = CHANGES[name]
    package = tmp_path / 'sources' / 'barc_sim'
    shutil.copytree(PACKAGE, package, ignore=shutil.ignore_patterns('__pycache__'))
    interfaces = package.with_name('barc_interfaces')
    interfaces.symlink_to(PACKAGE.with_name('barc_interfaces'))
    source = package / change.file
    text = source.read_text(encoding='utf-8')
    assert text.count(change.line) == 1
    source.write_text(text.replace(change.line, change.changed), encoding='utf-8')

    after = figures(tmp_path / 'changed', package)
    assert [part for part in usual if after[part] != usual[part]] == [
        part for part in usual if part in change.parts
    ]
    if (change.friction, change.lag) != (FRICTION, LAG):
        expected = figures(tmp_path / 'expected', PACKAGE, change.friction, change.lag)
        for part in WITH_PARAMETERS:
            assert after[part] == pytest.approx(expected[part], rel=1e-6, abs=1e-9), part
