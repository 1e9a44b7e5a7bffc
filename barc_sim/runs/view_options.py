"""Options that show a run: the live page, and the mirrors for ROS's own tools."""

from __future__ import annotations

import argparse

from barc_sim.cli.parser import FOXGLOVE_PORT, MAX_PORT, whole
from barc_sim.nodes.mirrors.kinds import MIRRORS


def add_view_options(parser: argparse.ArgumentParser, *, on: bool) -> None:
    """Add `--view`, `--view-port` and `--view-host`; `on` is the meaning of `auto`.

    Examples
    --------
    >>> parser = argparse.ArgumentParser()
    >>> add_view_options(parser, on=True)
    >>> parser.parse_args(['--view-port', '8000']).view_port
    8000
    """
    default = 'web' if on else 'none'
    parser.add_argument(
        '--view',
        choices=('auto', 'web', 'none'),
        default='auto',
        help=f'the live picture: a web page, or none (auto: {default})',
    )
    add_address_options(parser)
    parser.set_defaults(view_auto=default)


def add_address_options(parser: argparse.ArgumentParser, *, can: str = 'drive') -> None:
    """Add `--view-port` and `--view-host`; `can` is what a page's visitor can do."""
    parser.add_argument(
        '--view-port',
        type=whole(0, MAX_PORT),
        default=0,
        metavar='PORT',
        help='port of the page (any that is free)',
    )
    parser.add_argument(
        '--view-host',
        default='127.0.0.1',
        metavar='ADDRESS',
        help='address to serve the page at; 0.0.0.0 for a phone in the same network; the '
        f'whole address gives the right to {can} (127.0.0.1)',
    )


def wants_page(options: argparse.Namespace) -> bool:
    """Return whether to serve the live page; False for a program without these options.

    Examples
    --------
    >>> parser = argparse.ArgumentParser()
    >>> add_view_options(parser, on=True)
    >>> wants_page(parser.parse_args([])), wants_page(parser.parse_args(['--view', 'none']))
    (True, False)
    """
    choice = getattr(options, 'view', 'none')
    return bool((options.view_auto if choice == 'auto' else choice) == 'web')


def add_mirror_options(parser: argparse.ArgumentParser) -> None:
    """Add `--mirrors` and `--foxglove`."""
    parser.add_argument(
        '--mirrors',
        type=_mirrors,
        metavar='NAMES',
        help='standard messages for RViz, Foxglove and PlotJuggler: all, none, or some of '
        f'{",".join(MIRRORS)} (none)',
    )
    parser.add_argument(
        '--foxglove',
        type=whole(0, MAX_PORT),
        nargs='?',
        const=FOXGLOVE_PORT,
        metavar='PORT',
        help='serve every topic live to the Foxglove app on this machine, with all mirrors unless '
        f'--mirrors names others ({FOXGLOVE_PORT})',
    )


def wanted_mirrors(options: argparse.Namespace) -> frozenset[str]:
    """Return the mirrors named on the command line; without names, all for Foxglove, else none.

    Examples
    --------
    >>> parser = argparse.ArgumentParser()
    >>> add_mirror_options(parser)
    >>> sorted(wanted_mirrors(parser.parse_args(['--mirrors', 'odom,path'])))
    ['odom', 'path']
    >>> len(wanted_mirrors(parser.parse_args(['--foxglove'])))
    7
    """
    chosen = getattr(options, 'mirrors', None)
    if chosen is None:
        return frozenset(() if getattr(options, 'foxglove', None) is None else MIRRORS)
    return frozenset(chosen)


def _mirrors(text: str) -> frozenset[str]:
    if text in ('all', 'none'):
        return frozenset(MIRRORS if text == 'all' else ())
    names = frozenset(text.split(','))
    if not names <= set(MIRRORS):
        raise argparse.ArgumentTypeError(
            f"{text!r} is neither 'all', 'none' nor some of {','.join(MIRRORS)}"
        )
    return names
