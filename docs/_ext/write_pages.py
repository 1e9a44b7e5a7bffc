"""Writes the pages that have one section for each command and one page for each room."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

from barc_sim.commands import GROUPS

if TYPE_CHECKING:
    from pathlib import Path

#: In the order in which they import one another.
ROOMS = (
    'errors', 'cli', 'vehicle', 'control', 'simulation', 'tuning', 'bags', 'figures', 'page', 'lab',
    'ros', 'nodes', 'runs', 'commands',
)  # fmt: skip


def commands() -> str:
    """Return the text of the page of commands."""
    lines = ['Commands', '========', '']
    lines += [
        'Every command is a word behind ``barc``. The value in parentheses is the default.',
        '',
    ]
    for group, names in GROUPS.items():
        lines += [group[:1].upper() + group[1:], '-' * len(group), '']
        for name in names:
            lines += [f'.. _command-{name}:', '', f'barc {name}', '~' * (5 + len(name)), '']
            lines += [f'.. barc-options:: {name}', '']
    return '\n'.join(lines)


def room(name: str) -> str:
    """Return the text of the page of a room."""
    title = f'barc_sim.{name}'
    return '\n'.join([title, '=' * len(title), '', f'.. barc-room:: {name}', ''])


def rooms() -> str:
    """Return the text of the table of rooms, each with the first line of its docstring."""
    rows = []
    for name in ROOMS:
        about = (import_module(f'barc_sim.{name}').__doc__ or '').partition('\n\n')[0]
        rows += [f'   * - :doc:`{name} <{name}>`', f'     - {" ".join(about.split())}']
    return '\n'.join(
        ['.. list-table::', '   :widths: 20 80', '', *rows, '', '.. toctree::', '   :hidden:', '']
        + [f'   {name}' for name in ROOMS]
        + ['']
    )


def write(folder: Path) -> None:
    """Write them where they have changed, so that Sphinx reads again only those."""
    pages = {'reference/commands.rst': commands(), 'reference/api/rooms.inc': rooms()}
    pages |= {f'reference/api/{name}.rst': room(name) for name in ROOMS}
    for path, text in pages.items():
        target = folder / path
        target.parent.mkdir(parents=True, exist_ok=True)
        if not target.is_file() or target.read_text(encoding='utf-8') != text:
            target.write_text(text, encoding='utf-8')
