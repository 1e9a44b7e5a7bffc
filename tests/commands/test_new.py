"""The command `barc new`: a folder with the lab's templates."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest
from command_line import refused
from user_files import load_folder

from barc_sim.__main__ import main as barc
from barc_sim.commands.lab import write_templates
from barc_sim.lab.user_code.source import UserCodeError

if TYPE_CHECKING:
    from pathlib import Path

FILES = ['README.md', 'bike_model.py', 'compose.py', 'controller.py', 'relay.py']
UNFINISHED = r'is not written yet \(TODO\)'


def test_a_folder_has_the_templates_and_how_to_go_on_is_printed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert barc(['new', str(tmp_path / 'my lab')]) == 0
    assert sorted(path.name for path in (tmp_path / 'my lab').iterdir()) == FILES
    assert f"bin/barc acc --lab '{tmp_path}/my lab'" in capsys.readouterr().out


def test_each_template_can_be_loaded_and_is_unfinished(tmp_path: Path) -> None:
    write_templates(tmp_path / 'lab')
    lab = load_folder(tmp_path / 'lab')
    assert lab.model
    assert lab.controller
    assert lab.relay
    with pytest.raises(UserCodeError, match=UNFINISHED):
        lab.model(*[0.0] * 11)
    with pytest.raises(UserCodeError, match=UNFINISHED):
        lab.new_pid(1.0, 1.0, 1.0).acc_calculate(8.0, 0.0, 0.0)
    with pytest.raises(UserCodeError, match=UNFINISHED):
        lab.new_relay()(0.0, 0.0, dt=0.05)


def test_the_readme_names_every_template(tmp_path: Path) -> None:
    write_templates(tmp_path)
    text = (tmp_path / 'README.md').read_text()
    assert all(name in text for name in FILES[1:])


@pytest.mark.parametrize('name', FILES)
def test_nothing_is_written_over(tmp_path: Path, name: str) -> None:
    (tmp_path / name).write_text('mine')
    assert f'already has {name}' in refused('new', str(tmp_path))
    assert [path.name for path in tmp_path.iterdir()] == [name]
    assert (tmp_path / name).read_text() == 'mine'


@pytest.mark.parametrize('place', ['{file}', '{file}/lab', '/proc/lab'])
def test_a_place_that_cannot_be_written_to_is_named(tmp_path: Path, place: str) -> None:
    file = tmp_path / 'file'
    file.write_text('')
    assert refused('new', place.format(file=file))
