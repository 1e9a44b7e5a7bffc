"""Names in a bag, and of files, that would control the terminal are printed as escapes."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import pytest
from command_line import barc
from made_bags import VALUE, make

from barc_sim.bags.messages import BagMessage
from barc_sim.bags.writer import BagWriter
from barc_sim.cli.parser import Parser, report, show, warn
from barc_sim.simulation.closed_loop import simulate

if TYPE_CHECKING:
    from pathlib import Path

#: Clears the screen, and sets the window's title.
HOSTILE = '\x1b[2J\x1b]0;title\x07\x9b1m'


def is_harmless(text: str) -> bool:
    return all(c.isprintable() or c == '\n' for c in text)


@pytest.fixture(scope='module')
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the bag of a run whose folder and metadata have hostile names."""
    folder = tmp_path_factory.mktemp('bags') / f'bag{HOSTILE}'
    return make(folder, simulate(distance=5.0), {HOSTILE: HOSTILE, 'command': HOSTILE})


@pytest.fixture(scope='module')
def topics(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a bag whose topic has a hostile name and type."""
    folder = tmp_path_factory.mktemp('topics') / 'bag'
    folder.mkdir()
    writer = BagWriter(folder)
    topic = replace(VALUE, name=f'/{HOSTILE}', type=f'std_msgs/msg/{HOSTILE}')
    writer.write([BagMessage(topic, b'\0' * 12, 1, 1, 0)])
    writer.close()
    return folder


@pytest.mark.parametrize(
    'words', ['info', 'info --json', 'plot --save', 'convert', 'recover', 'report', 'graph --save']
)
def test_no_command_on_a_bag_prints_what_controls_a_terminal(
    words: str, bag: Path, topics: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    name, *options = words.split()
    if '--save' in options:
        options.append(f'figure{HOSTILE}.png')
    for path in (bag, topics):
        process = barc(name, str(path), *options)
        assert process.stdout + process.stderr
        assert is_harmless(process.stdout + process.stderr)


def test_errors_warnings_and_lines_are_printed_as_escapes(
    capsys: pytest.CaptureFixture[str],
) -> None:
    show(HOSTILE)
    warn(HOSTILE)
    report('barc', HOSTILE)
    with pytest.raises(SystemExit):
        Parser(prog='barc').error(HOSTILE)
    printed = capsys.readouterr()
    assert is_harmless(printed.out + printed.err)
    assert (printed.out + printed.err).count(r'\x1b[2J') == 4
