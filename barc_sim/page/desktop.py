"""Opens the live page in the desktop's browser, where there is one."""

from __future__ import annotations

import os
import webbrowser
from threading import Thread
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Mapping


NO_BROWSER = 'BARC_SIM_NO_BROWSER'


def open_page(url: str, environment: Mapping[str, str] = os.environ) -> bool:
    """Open `url` without waiting for the browser; return False where there is no desktop.

    `BARC_SIM_NO_BROWSER` in the environment keeps it from opening.
    """
    if environment.get(NO_BROWSER):
        return False
    screen = environment.get('DISPLAY') or environment.get('WAYLAND_DISPLAY')
    if not screen or environment.get('SSH_CONNECTION'):  # the user sits at another screen
        return False
    Thread(target=webbrowser.open, args=(url,), name='browser', daemon=True).start()
    return True
