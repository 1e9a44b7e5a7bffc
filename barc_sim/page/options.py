"""The options of the live page, and its address in a browser where there is one."""

from __future__ import annotations

import os
import webbrowser
from threading import Thread
from typing import TYPE_CHECKING

from barc_sim.cli.option_types import GREATEST_PORT, whole

if TYPE_CHECKING:
    import argparse
    from collections.abc import Mapping


def add_view_options(parser: argparse.ArgumentParser, *, on: bool) -> None:
    """Add `--view`, `--view-port` and `--view-host`; `on` says what `auto` stands for."""
    default = 'web' if on else 'none'
    parser.add_argument(
        '--view',
        choices=('auto', 'web', 'none'),
        default='auto',
        help=f'the live picture: a web page, or none (auto: {default})',
    )
    add_address_options(parser)
    parser.set_defaults(view_auto=default)


def add_address_options(parser: argparse.ArgumentParser) -> None:
    """Add `--view-port` and `--view-host`."""
    parser.add_argument(
        '--view-port',
        type=whole(0, GREATEST_PORT),
        default=0,
        metavar='PORT',
        help='port of the page (any that is free)',
    )
    parser.add_argument(
        '--view-host',
        default='127.0.0.1',
        metavar='ADDRESS',
        help='address to serve the page at; 0.0.0.0 for a phone in the same network: who is told '
        'the whole address may drive (127.0.0.1)',
    )


def wanted(options: argparse.Namespace) -> bool:
    """Return whether the live page is to be served; not by a program without these options."""
    choice = getattr(options, 'view', 'none')
    return bool((options.view_auto if choice == 'auto' else choice) == 'web')


def has_desktop(environment: Mapping[str, str] = os.environ) -> bool:
    """Return whether there is a screen here, and the user in front of it."""
    screen = environment.get('DISPLAY') or environment.get('WAYLAND_DISPLAY')
    return bool(screen) and not environment.get('SSH_CONNECTION')


def open_page(url: str) -> bool:
    """Open `url` in the desktop's browser without waiting for it; False where there is none."""
    if not has_desktop():
        return False
    Thread(target=webbrowser.open, args=(url,), name='browser', daemon=True).start()
    return True
