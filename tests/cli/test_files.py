"""Files in a folder that somebody else may have made: what is opened, and what is written."""

from __future__ import annotations

import os
import socket
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from barc_sim.cli.files import (
    check_plain,
    make_folder,
    open_regular,
    read_regular,
    replacing,
    saving,
    target,
)
from barc_sim.errors import UserError

if TYPE_CHECKING:
    from collections.abc import Callable


def _socket(path: Path) -> None:
    with socket.socket(socket.AF_UNIX) as listener:
        listener.bind(str(path))


SPECIAL: dict[str, Callable[[Path], object]] = {
    'a folder': Path.mkdir,
}
if hasattr(os, 'mkfifo'):  # not on Windows
    SPECIAL |= {
        'a named pipe': os.mkfifo,
        'a socket': _socket,
        'a device': lambda path: path.symlink_to('/dev/zero'),
    }


@pytest.mark.parametrize('kind', SPECIAL)
def test_a_file_that_is_not_regular_is_refused_without_waiting(kind: str, tmp_path: Path) -> None:
    SPECIAL[kind](tmp_path / 'x')
    with pytest.raises(UserError, match=f'x.* is {kind}, where a regular file is expected'):
        open_regular(tmp_path / 'x')


def test_a_link_is_followed_where_the_user_names_it_alone(tmp_path: Path) -> None:
    (tmp_path / 'file').write_text('content')
    (tmp_path / 'link').symlink_to('file')
    assert read_regular(tmp_path / 'link', 100) == b'content'
    with pytest.raises(UserError, match='is a link'):
        read_regular(tmp_path / 'link', 100, follow=False)
    assert read_regular(tmp_path / 'file', 7, follow=False) == b'content'


def test_a_file_takes_its_place_when_it_is_whole(tmp_path: Path) -> None:
    path = tmp_path / 'run.gif'
    path.write_text('old')
    with replacing(path, sync=True) as part:
        part.write_text('new')
        assert path.read_text() == 'old'
        assert part.suffix == '.gif'
    assert path.read_text() == 'new'
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize('there', [True, False], ids=['link', 'dangling link'])
def test_a_link_is_replaced_and_not_followed(there: bool, tmp_path: Path) -> None:
    outside, path = tmp_path / 'bashrc', tmp_path / 'bag' / 'run.gif'
    path.parent.mkdir()
    if there:
        outside.write_text('mine')
    path.symlink_to(outside)
    with replacing(path) as part:
        part.write_text('new')

    assert path.read_text() == 'new'
    assert not path.is_symlink()
    assert outside.exists() == there
    assert not there or outside.read_text() == 'mine'


@pytest.mark.parametrize('error', [KeyboardInterrupt, RuntimeError])
def test_a_file_stays_as_it_was_when_writing_is_broken_off(
    tmp_path: Path, error: type[BaseException]
) -> None:
    path = tmp_path / 'run.gif'
    path.write_text('old')

    def break_off() -> None:
        with replacing(path) as part:
            part.write_text('half')
            raise error

    with pytest.raises(error):
        break_off()
    assert path.read_text() == 'old'
    assert list(tmp_path.iterdir()) == [path]


def test_a_place_where_nothing_can_be_written_is_refused_at_once(tmp_path: Path) -> None:
    (tmp_path / 'file').touch()
    for path in (tmp_path / 'missing' / 'run.gif', tmp_path / 'file' / 'run.gif'):
        with pytest.raises(UserError, match='choose another place') as raised, saving(path):
            pytest.fail('the block ran')
        assert repr(str(path)) in str(raised.value)


def test_an_error_of_the_disk_is_one_sentence(tmp_path: Path) -> None:
    with (
        pytest.raises(UserError, match=r'cannot save .*run\.mp4.*: No space left on device'),
        saving(tmp_path / 'run.mp4'),
    ):
        raise OSError(28, os.strerror(28))


@pytest.mark.parametrize('name', ['run.avi', 'run', 'run.mp4.txt', '.mp4', ''])
def test_another_extension_is_refused_with_those_that_work(name: str) -> None:
    with pytest.raises(UserError, match=r'must end in \.mp4 or \.gif') as raised:
        target(name, ('mp4', 'gif'))
    assert repr(name) in str(raised.value)


def test_folders_are_made_within_a_folder_and_not_through_its_links(tmp_path: Path) -> None:
    out = tmp_path / 'link'
    (tmp_path / 'grades').mkdir()
    out.symlink_to('grades')  # the user's own
    make_folder(out / 'a' / 'b', out)
    make_folder(out / 'a' / 'b', out)
    assert (tmp_path / 'grades' / 'a' / 'b').is_dir()

    (out / 'c').symlink_to(tmp_path)
    with pytest.raises(OSError, match='not a plain folder'):
        make_folder(out / 'c' / 'd', out)
    assert not (tmp_path / 'd').exists()


def test_a_folder_with_anything_but_plain_files_is_not_plain(tmp_path: Path) -> None:
    (tmp_path / 'bag_0.mcap').touch()
    check_plain(tmp_path)
    (tmp_path / 'metadata.yaml').symlink_to('bag_0.mcap')
    with pytest.raises(UserError, match=r"metadata\.yaml' is a link, where a bag has plain files"):
        check_plain(tmp_path)
