"""Opens the live page in a browser, without its token in the browser's arguments.

Every user of a machine can read the arguments of all programs (`ps`). So the browser receives the
path of a private file, which redirects it to the page.
"""

from __future__ import annotations

import os
import shutil
import tempfile
import webbrowser
from html import escape
from pathlib import Path
from threading import Thread

from barc_sim.cli.process import is_at_desktop

_TEXT = """<!DOCTYPE html>
<html lang="en">
<meta charset="utf-8">
<meta name="referrer" content="no-referrer">
<meta http-equiv="refresh" content="0; url={url}">
<title>barc_sim</title>
<p><a href="{url}">Open the live page</a></p>
</html>
"""


class RedirectFile:
    """A file that redirects a browser to a page, and that no other user can read.

    Examples
    --------
    >>> file = RedirectFile('http://127.0.0.1:8080/secret/')
    >>> file.address.startswith('file://'), 'secret' in file.address
    (True, False)
    >>> file.remove()
    """

    def __init__(self, url: str) -> None:
        """Write the file; OSError: it cannot be written."""
        self._folder = _private_folder()
        path = self._folder / 'page.html'
        path.touch(mode=0o600, exist_ok=False)
        path.write_text(_TEXT.format(url=escape(url)), encoding='utf-8')
        self.address = path.as_uri()  #: for the browser

    def remove(self) -> None:
        """Remove the file with its folder."""
        shutil.rmtree(self._folder, ignore_errors=True)


def _private_folder() -> Path:
    """Return a new folder that only this user can open.

    It is in the home directory: a browser installed by snap, as on Ubuntu, can open neither /tmp
    nor hidden folders.
    """
    try:
        return Path(tempfile.mkdtemp(prefix='barc_sim-page-', dir=Path('~').expanduser()))
    except (OSError, RuntimeError):  # there is no home directory
        return Path(tempfile.mkdtemp(prefix='barc_sim-page-'))


def open_page(url: str) -> RedirectFile | None:
    """Open `url` in a browser if there is a desktop, without waiting.

    Return the file that redirects the browser, to be removed afterwards.
    """
    if not is_at_desktop():
        return None

    file = None
    address = url
    if 'WSL_DISTRO_NAME' not in os.environ:  # a browser of Windows cannot open a path of Linux
        try:
            file = RedirectFile(url)
        except OSError:  # the user can open the link that is printed
            return None
        address = file.address

    Thread(target=webbrowser.open, args=(address,), name='browser', daemon=True).start()
    return file
