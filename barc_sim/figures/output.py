"""Puts a figure into a file, or into a window if there is a display."""

from __future__ import annotations

import os
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from barc_sim.errors import UserError

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from matplotlib.figure import Figure


def target(name: str, formats: Sequence[str]) -> Path:
    """Return the path `name`, which must end in one of `formats`, such as `png`.

    Raises
    ------
    UserError
        if it has another extension, or is a directory.

    Examples
    --------
    >>> target('speed.png', ('png', 'svg')).name
    'speed.png'
    """
    path = Path(name)
    if path.suffix.lower().lstrip('.') not in formats:
        *others, last = (f'.{suffix}' for suffix in formats)
        wanted = f'{", ".join(others)} or {last}' if others else last
        raise UserError(f'cannot save {name!r}: the name must end in {wanted}')
    if path.is_dir():
        raise UserError(f'cannot save {name!r}: there is a directory of that name')
    return path


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Give a temporary file to write, which replaces `path` when the block succeeds.

    If the block fails, a file at `path` stays unchanged, and no partial file is left.

    Raises
    ------
    UserError
        at once if nothing can be written there, or when writing fails later.
    """
    part = path.with_name(f'.{path.stem}.{os.getpid()}{path.suffix}')
    try:
        part.touch()
    except OSError as error:
        raise _unwritable(path, error) from None
    try:
        yield part
        part.replace(path)
    except OSError as error:
        raise _unwritable(path, error) from None
    finally:
        part.unlink(missing_ok=True)


def _unwritable(path: Path, error: OSError) -> UserError:
    reason = error.strerror or str(error).partition('\n')[0]
    return UserError(f'cannot save {str(path)!r}: {reason}; choose another place with --save')


def window(size: tuple[float, float], title: str) -> Figure | None:
    """Return an empty figure of `size` [inch] in a window; None if no window can be opened.

    `show` shows it.
    """
    from matplotlib import pyplot as plt  # noqa: PLC0415 (chooses a backend: not for saving)

    try:
        figure = plt.figure(title, figsize=size)
    except ImportError:  # the backend that the user has chosen cannot run here
        return None
    if figure.canvas.required_interactive_framework is None:
        plt.close(figure)
        return None
    return figure


def show() -> None:
    """Show the windows until the user has closed them."""
    from matplotlib import pyplot as plt  # noqa: PLC0415

    plt.show()
