"""The page's secret token, kept for each checkout and port, so that a page survives a restart."""

from __future__ import annotations

import hmac
import os
from contextlib import suppress
from functools import partial
from pathlib import Path
from secrets import token_bytes

_CHECKOUT = Path(__file__).resolve().parents[2]
_LENGTH = 32  #: [byte] of the secret
_SHOWN = 22  #: characters of a token


def kept_token(port: int, state: Path | None = None) -> str | None:
    """Return the token of this checkout's page on `port`; None where no secret can be kept.

    It derives from a secret that only the user can read, in `state`: by default the user's
    directory for state.

    Examples
    --------
    >>> token = kept_token(8080, Path('state'))
    >>> token == kept_token(8080, Path('state'))
    True
    """
    secret = _secret(state or _state_directory())
    if secret is None:
        return None
    return hmac.new(secret, f'{_CHECKOUT}:{port}'.encode(), 'sha256').hexdigest()[:_SHOWN]


def _state_directory() -> Path:
    home = os.environ.get('XDG_STATE_HOME') or Path('~/.local/state').expanduser()
    return Path(home) / 'barc_sim'


def _secret(directory: Path) -> bytes | None:
    """Return the user's secret, made where there is none."""
    path = directory / 'page_secret'
    with suppress(OSError, RuntimeError):
        directory.mkdir(mode=0o700, parents=True, exist_ok=True)
        with (
            suppress(FileExistsError),
            open(path, 'xb', opener=partial(os.open, mode=0o600)) as file,
        ):
            file.write(token_bytes(_LENGTH))
        secret = path.read_bytes()
        if len(secret) == _LENGTH and _is_private(path.stat()):
            return secret
    return None


def _is_private(status: os.stat_result) -> bool:
    """Return whether a file is the user's own, and no other user can read it."""
    if not hasattr(os, 'getuid'):  # on Windows the user's folder is closed to others
        return True
    return status.st_uid == os.getuid() and not status.st_mode & 0o077
