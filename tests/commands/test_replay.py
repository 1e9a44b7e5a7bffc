"""The replay command: a run's video lasts as long as the run, and goes where it should."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING

import imageio_ffmpeg
import pytest
from command_line import refused

from barc_sim.__main__ import main as barc
from barc_sim.bags import reader as bag
from barc_sim.figures import views
from barc_sim.simulation.closed_loop import closed_loop

if TYPE_CHECKING:
    from pathlib import Path

    from barc_sim.simulation.log import Log


@pytest.fixture
def log() -> Log:
    return closed_loop(distance=3.0)


@pytest.fixture
def directory(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, log: Log) -> Path:
    """Return the directory of a bag that reads as `log`."""
    path = tmp_path / 'bag'
    path.mkdir()
    monkeypatch.setattr(bag, 'read', lambda *_: log)
    monkeypatch.setattr(bag, 'newest', lambda: path)
    return path


def test_an_mp4_has_a_frame_per_state_and_lasts_as_long_as_the_run(
    directory: Path, tmp_path: Path, log: Log, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / 'run.mp4'
    assert barc(['replay', str(directory), '--save', str(path)]) == 0
    frames, seconds = imageio_ffmpeg.count_frames_and_secs(path)
    assert frames == len(log)
    assert seconds == pytest.approx(log.t[-1] + 0.02, abs=0.011)
    assert capsys.readouterr().out == f'{path}\n'


def test_without_ffmpeg_a_gif_is_made_and_an_mp4_refused_in_one_sentence(
    directory: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv('PATH', str(tmp_path))
    monkeypatch.setitem(sys.modules, 'imageio_ffmpeg', None)
    name = str(tmp_path / 'run.mp4')
    assert 'none is on the PATH' in refused('replay', str(directory), '--save', name)
    name = str(tmp_path / 'run.gif')
    assert barc(['replay', '--save', name]) == 0  # the newest bag


def test_the_ffmpeg_of_the_path_is_used_and_its_error_is_the_reason(
    directory: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    program = tmp_path / 'ffmpeg'
    program.write_text('#!/bin/sh\necho Unknown encoder >&2\nexit 1\n', encoding='utf-8')
    program.chmod(0o755)
    monkeypatch.setenv('PATH', str(tmp_path), prepend=':')
    name = str(tmp_path / 'run.mp4')
    assert f'{program}: Unknown encoder' in refused('replay', str(directory), '--save', name)


def test_ctrl_c_leaves_no_half_a_video(
    directory: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken_off(path: Path, *_: object, **__: object) -> None:
        path.write_bytes(b'half')
        raise KeyboardInterrupt

    monkeypatch.setattr(views, 'write_mp4', broken_off)
    assert barc(['replay', str(directory), '--save', str(tmp_path / 'run.mp4')]) == 130
    assert list(tmp_path.iterdir()) == [directory]
