"""Where figures go: what can be saved, how, and whether there is a window."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from barc_sim.errors import UserError
from barc_sim.figures import output


@pytest.mark.parametrize('name', ['run.mp4', 'some.where/run.GIF'])
def test_a_name_with_a_format_that_works_is_a_target(name: str) -> None:
    assert output.target(name, ('mp4', 'gif')) == Path(name)


@pytest.mark.parametrize('name', ['run.avi', 'run', 'run.mp4.txt', '.mp4', ''])
def test_another_extension_is_refused_with_those_that_work(name: str) -> None:
    with pytest.raises(UserError, match=r'must end in \.mp4 or \.gif') as raised:
        output.target(name, ('mp4', 'gif'))
    assert repr(name) in str(raised.value)


def test_a_directory_is_no_target(tmp_path: Path) -> None:
    (tmp_path / 'run.mp4').mkdir()
    with pytest.raises(UserError, match='directory'):
        output.target(str(tmp_path / 'run.mp4'), ('mp4',))


def test_a_file_takes_its_place_when_it_is_whole(tmp_path: Path) -> None:
    path = tmp_path / 'run.gif'
    path.write_text('old')
    with output.replacing(path) as part:
        part.write_text('new')
        assert path.read_text() == 'old'
        assert part.suffix == '.gif'
    assert path.read_text() == 'new'
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize('error', [KeyboardInterrupt, RuntimeError])
def test_a_file_stays_as_it_was_when_writing_is_broken_off(
    tmp_path: Path, error: type[BaseException]
) -> None:
    path = tmp_path / 'run.gif'
    path.write_text('old')

    def break_off() -> None:
        with output.replacing(path) as part:
            part.write_text('half')
            raise error

    with pytest.raises(error):
        break_off()
    assert path.read_text() == 'old'
    assert list(tmp_path.iterdir()) == [path]


def test_a_place_where_nothing_can_be_written_is_refused_at_once(tmp_path: Path) -> None:
    (tmp_path / 'file').touch()
    for path in (tmp_path / 'missing' / 'run.gif', tmp_path / 'file' / 'run.gif'):
        with (
            pytest.raises(UserError, match='choose another place') as raised,
            output.replacing(path),
        ):
            pytest.fail('the block ran')
        assert repr(str(path)) in str(raised.value)


def test_an_error_of_the_disk_is_one_sentence(tmp_path: Path) -> None:
    with (
        pytest.raises(UserError, match=r'cannot save .*run\.mp4.*: No space left on device'),
        output.replacing(tmp_path / 'run.mp4'),
    ):
        raise OSError(28, os.strerror(28))


@pytest.mark.parametrize('backend', [None, 'agg', 'tkagg'])
def test_without_a_display_there_is_no_window(backend: str | None) -> None:
    environment = {
        name: value
        for name, value in os.environ.items()
        if name not in {'DISPLAY', 'WAYLAND_DISPLAY', 'MPLBACKEND'}
    }
    script = 'from barc_sim.figures import output; print(output.window((4, 3), str()))'
    result = subprocess.run(
        [sys.executable, '-c', script],
        env=environment | ({'MPLBACKEND': backend} if backend else {}),
        capture_output=True,
        text=True,
        check=True,
    )
    assert (result.stdout.strip(), result.stderr) == ('None', '')
