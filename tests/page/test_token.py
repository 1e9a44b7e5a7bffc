"""The page's token: the same for each run on a port, and secret."""

from __future__ import annotations

import os
from pathlib import Path

from barc_sim.page.server import kept_token


def test_token_is_that_of_the_port_and_the_user(tmp_path: Path) -> None:
    token = kept_token(8080, tmp_path / 'a')
    assert token
    assert len(token) >= 22
    assert kept_token(8080, tmp_path / 'a') == token
    assert kept_token(8081, tmp_path / 'a') != token
    assert kept_token(8080, tmp_path / 'b') != token
    (secret,) = (tmp_path / 'a').iterdir()
    assert secret.stat().st_mode & 0o077 == 0


def test_secret_that_others_can_read_is_not_used(tmp_path: Path) -> None:
    kept_token(8080, tmp_path)
    (secret,) = tmp_path.iterdir()
    secret.chmod(0o644)
    assert kept_token(8080, tmp_path) is None


def test_no_directory_for_the_secret_gives_no_token(tmp_path: Path) -> None:
    (tmp_path / 'file').touch()
    assert kept_token(8080, tmp_path / 'file') is None


def test_something_else_in_place_of_the_secret_is_neither_read_nor_followed(tmp_path: Path) -> None:
    foreign = tmp_path / 'foreign'
    foreign.write_bytes(bytes(32))
    foreign.chmod(0o600)
    for name, make in {
        'pipe': os.mkfifo,
        'folder': Path.mkdir,
        'link': lambda path: path.symlink_to(foreign),
    }.items():
        state = tmp_path / name
        state.mkdir()
        make(state / 'page_secret')
        assert kept_token(8080, state) is None
    assert foreign.read_bytes() == bytes(32)
