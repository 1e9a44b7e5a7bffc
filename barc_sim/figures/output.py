"""Shows figures in windows, if there is a display."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from matplotlib.figure import Figure


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
