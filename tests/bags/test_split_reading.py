"""A bag that is split at any place reads the same as the whole one, through every reader."""

from __future__ import annotations

import json
import shutil
from contextlib import closing
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

import numpy as np
import pytest
from command_line import printed
from hypothesis import given, settings
from hypothesis import strategies as st
from made_bags import GRAPH, PARAMETERS, fill

from barc_sim.bags import reader
from barc_sim.bags.contents import Contents
from barc_sim.bags.convert import log_of_fields
from barc_sim.bags.writer import BagWriter
from barc_sim.simulation.closed_loop import closed_loop

if TYPE_CHECKING:
    from collections.abc import Sequence

    from barc_sim.bags.messages import BagMessage

LOG = closed_loop(distance=4.0)
METADATA = {'parameters': PARAMETERS, 'graph': GRAPH}
FIELDS = {'v_x': '/z_vhcl.v_x', 'motor': '/ecu.motor'}


@pytest.fixture(scope='module')
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the bag of a run, of one file."""
    path = tmp_path_factory.mktemp('bags') / 'run'
    path.mkdir()
    with closing(BagWriter(path, metadata=METADATA)) as writer:
        fill(writer, LOG)
    return path


def split(messages: Sequence[BagMessage], places: Sequence[int], folder: Path) -> Path:
    """Write messages to a bag with a new file at each of `places`."""
    path = folder / 'run'
    path.mkdir()
    ends = [*sorted(places), len(messages)]
    begin = 0
    for number, end in enumerate(ends):
        part = folder / 'part'
        part.mkdir()
        with closing(BagWriter(part, metadata=METADATA)) as writer:
            writer.write(messages[begin:end])
        (part / 'part_0.mcap').rename(path / f'run_{number}.mcap')
        shutil.rmtree(part)
        begin = end
    return path


OF_FILES = ('files', 'file_spans')


def described(path: Path) -> dict[str, object]:
    """Return what `barc info` prints of a bag, without its files."""
    content = json.loads(printed('info', str(path), '--json'))
    return {name: value for name, value in content.items() if name not in ('path', *OF_FILES)}


def tables(path: Path, output: Path) -> dict[str, str]:
    """Return the tables that `barc convert` makes of a bag, by name."""
    printed('convert', str(path), '-o', str(output))
    return {file.name: file.read_text() for file in output.iterdir()}


@settings(max_examples=10)
@given(places=st.lists(st.integers(0, 1000), min_size=1, max_size=6))
def test_a_bag_split_anywhere_reads_as_the_whole_one(whole: Path, places: list[int]) -> None:
    messages = [*Contents(whole).messages()]
    with TemporaryDirectory() as name:
        folder = Path(name)
        path = split(messages, [min(place, len(messages)) for place in places], folder)

        assert [*Contents(path).in_order()] == [*Contents(whole).in_order()]
        middle = messages[len(messages) // 2].received
        assert [*Contents(path).messages(middle)] == [*Contents(whole).messages(middle)]
        assert described(path) == described(whole)
        assert reader.info(path) == reader.info(whole)
        expected = reader.read(whole)
        log = reader.read(path)
        for column, values in expected.columns().items():
            np.testing.assert_array_equal(log.columns()[column], values)
        assert log.parameters.keys() == expected.parameters.keys()
        np.testing.assert_array_equal(
            log_of_fields(path, FIELDS).v_x, log_of_fields(whole, FIELDS).v_x
        )
        assert tables(path, folder / 'split') == tables(whole, folder / 'whole')
        printed('recover', str(path), '-o', str(folder / 'recovered'))
        assert [*Contents(folder / 'recovered').messages()] == messages
