"""Opens and closes the windows of figures, where there is a display."""

from __future__ import annotations

from typing import TYPE_CHECKING

from barc_sim.figures.colours import STYLE

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def window(title: str) -> Figure | None:
    """Return an empty figure in a window, which `show` opens; None if that is impossible."""
    from matplotlib import pyplot as plt  # noqa: PLC0415 (chooses a backend: not for saving)

    try:
        with plt.style.context(STYLE):
            figure = plt.figure(title)
    except ImportError:  # the user's backend is not available here
        return None
    if figure.canvas.required_interactive_framework is None:
        plt.close(figure)
        return None
    return figure


def show(*, block: bool = True) -> None:
    """Show the windows; with `block`, wait until the user has closed them."""
    from matplotlib import pyplot as plt  # noqa: PLC0415

    plt.show(block=block)


def close(figure: Figure) -> None:
    """Close the window of a figure."""
    from matplotlib import pyplot as plt  # noqa: PLC0415

    plt.close(figure)
