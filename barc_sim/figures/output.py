"""Where a figure goes: into a file, or into a window where there is a display."""

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
    """Return the path called `name` if a file of one of `formats` (such as `png`) can be there.

    Raises
    ------
    UserError
        where its extension is none of them, or it is a directory.
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
    """Give a new file beside `path` to write, which takes its place when the block succeeds.

    Whatever breaks the block off, a file that was at `path` stays as it was, and no half of a new
    one is left.

    Raises
    ------
    UserError
        at once where nothing can be written there, or where writing failed later.
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
    """Return an empty figure of `size` [inch] in a window; None where none can be opened.

    `show` then shows it.
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
