"""The plot command: where its figure goes, and its errors."""

from __future__ import annotations

from pathlib import Path

import pytest
import yaml
from command_line import refused
from made_bags import make
from matplotlib.figure import Figure
from matplotlib.text import Text

from barc_sim.__main__ import main as barc
from barc_sim.bags import reader as bag
from barc_sim.figures import files, windows
from barc_sim.simulation.closed_loop import closed_loop

SIGNATURES = {'png': b'\x89PNG', 'pdf': b'%PDF', 'svg': b'<?xml'}


@pytest.fixture
def directory(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return the bag of a short run, on a machine without display."""
    log = closed_loop(distance=30.0)
    path = tmp_path / 'bags' / '2026-11-21_12-00-00'
    path.parent.mkdir()
    make(path, log, {'road': 'lab', 'kp': '30.0', 'python': '3.12'})
    monkeypatch.setattr(bag, 'newest', lambda: path.relative_to(tmp_path))
    monkeypatch.setattr(windows, 'window', lambda *_: None)
    monkeypatch.chdir(tmp_path)
    return path


@pytest.mark.parametrize('suffix', ['png', 'pdf', 'svg'])
def test_the_figure_is_saved_in_the_format_of_its_name(
    directory: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], suffix: str
) -> None:
    path = tmp_path / f'figure.{suffix}'
    assert barc(['plot', str(directory), '--save', str(path)]) == 0
    assert path.read_bytes().startswith(SIGNATURES[suffix])
    assert capsys.readouterr().out == f'{path}\n'


def test_without_display_and_name_the_figure_is_saved_in_the_newest_bag(
    directory: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert barc(['plot']) == 0
    path = directory / 'speed.png'
    assert path.read_bytes().startswith(SIGNATURES['png'])
    assert capsys.readouterr().out == f'{path.relative_to(tmp_path)}\n'


def test_the_heading_names_the_bag_its_road_and_its_gains(
    directory: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    window = Figure()
    monkeypatch.setattr(windows, 'window', lambda *_: window)
    monkeypatch.setattr(windows, 'show', lambda: None)
    assert barc(['plot', str(directory)]) == 0
    words = {text.get_text() for text in window.findobj(Text)}
    assert {'2026-11-21_12-00-00', 'road lab · kp 30.0'} <= words


def saved_words(monkeypatch: pytest.MonkeyPatch, *arguments: str) -> set[str]:
    """Return the words of the figure that `barc plot` saves."""
    figures: list[Figure] = []
    monkeypatch.setattr(files, 'save_figure', lambda _, figure: figures.append(figure))
    assert barc(['plot', *arguments, '--save', 'runs.png']) == 0
    (figure,) = figures
    return {text.get_text() for text in figure.findobj(Text)}


def parameters(**controller: object) -> str:
    nodes = {'/controller': {'ros__parameters': controller}}
    return yaml.safe_dump(nodes, sort_keys=False)


def test_several_runs_are_labelled_by_their_differences_and_headed_by_what_they_share(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    log = closed_loop(distance=12.0)
    of_runs = {
        'a': {'controller_type': 'pid', 'kp': 5.0, 'ki': 200.0, 'realtime_factor': 1.0},
        'b': {'controller_type': 'pid', 'kp': 20.0, 'ki': 200.0, 'realtime_factor': 0.0},
        'c': {'controller_type': 'lqr', 'effort_weight': 1.0},
        'd': {'controller_type': 'lqr', 'effort_weight': 1.0},
    }
    for name, values in of_runs.items():
        make(Path(name), log, {'road': 'lab', 'parameters': parameters(**values)})
    words = saved_words(monkeypatch, *of_runs)

    assert {'pid, kp 5', 'pid, kp 20', 'lqr (c)', 'lqr (d)', '4 runs', 'road lab'} <= words
    assert not any('realtime' in word or 'weight' in word for word in words)
    assert {'kp 5', 'kp 20'} <= saved_words(monkeypatch, 'a', 'b')


def test_bags_of_one_name_are_told_apart_by_their_paths(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    for name in ('one/run', 'two/run', 'two/other'):
        Path(name).parent.mkdir(exist_ok=True)
        make(Path(name), closed_loop(distance=12.0), {})
    words = saved_words(monkeypatch, 'one/run', 'two/run', 'two/other')
    assert {'one/run', 'two/run', 'other'} <= words


@pytest.mark.parametrize(
    'text', ['[', '- a', '/controller: 3', '/controller: {ros__parameters: 1}']
)
def test_a_description_that_cannot_be_read_labels_no_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, text: str
) -> None:
    monkeypatch.chdir(tmp_path)
    for name in ('a', 'b'):
        info = {'parameters': text, 'student_code': text}
        make(Path(name), closed_loop(distance=12.0), info)
    assert {'a', 'b'} <= saved_words(monkeypatch, 'a', 'b')


def test_the_comparison_of_runs_needs_a_display_or_a_name(directory: Path) -> None:
    assert 'name a file with --save' in refused('plot', str(directory), str(directory))


@pytest.mark.parametrize(
    ('args', 'saved'), [([], False), (['--show'], False), (['--show', '--save', 'a.png'], True)]
)
def test_with_a_display_the_figure_is_shown(
    directory: Path, monkeypatch: pytest.MonkeyPatch, args: list[str], saved: bool
) -> None:
    window, figures = Figure(), []
    monkeypatch.setattr(windows, 'window', lambda *_: window)
    monkeypatch.setattr(windows, 'show', lambda: figures.append(len(window.axes)))
    assert barc(['plot', str(directory), *args]) == 0
    assert figures == [4]
    assert Path('a.png').exists() == saved
    assert not (directory / 'speed.png').exists()


@pytest.mark.parametrize(
    ('args', 'complaint'),
    [
        (['--show'], 'cannot open a window'),
        (['--save', 'run.jpeg'], "'run.jpeg': the name must end in .png, .pdf or .svg"),
        (['--save', ''], "'': the name must end in"),
        (['--save', 'nowhere/a.png'], "'nowhere/a.png': No such file or directory"),
    ],
)
def test_plot_refuses_a_mistake_in_one_sentence(
    directory: Path, args: list[str], complaint: str
) -> None:
    assert complaint in refused('plot', str(directory), *args)


@pytest.mark.parametrize('command', ['plot', 'replay'])
@pytest.mark.parametrize('name', ['missing', 'empty', 'empty.mcap', 'foreign.mcap'])
def test_a_path_that_is_not_a_bag_is_refused_in_one_line(
    tmp_path: Path, command: str, name: str
) -> None:
    (tmp_path / 'empty').mkdir()
    (tmp_path / 'empty.mcap').touch()
    (tmp_path / 'foreign.mcap').write_text('not a bag')
    assert str(tmp_path / name) in refused(command, str(tmp_path / name))
