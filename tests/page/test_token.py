"""The page's token: the same for each run on a port, and secret."""

from __future__ import annotations

from typing import TYPE_CHECKING

from barc_sim.page.token import kept_token

if TYPE_CHECKING:
    from pathlib import Path


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
