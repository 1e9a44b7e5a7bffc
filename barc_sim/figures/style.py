"""Palette, style, limits of axes and readings, for figures and page; opens windows.

Matplotlib is imported only to open a window: the live page starts without it.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar

import numpy as np

from barc_sim.simulation.metrics import RUN_UP
from barc_sim.vehicle.road import Road

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from numpy.typing import NDArray

    from barc_sim.simulation.log import Log


class Colour(NamedTuple):
    """A colour on a light background, as in figures, and on the page's dark background."""

    light: str
    dark: str


# Any two colours differ for readers with any colour blindness; each has a contrast of 3:1 with the
# background (tests/figures/test_style.py). A colour has one meaning in figures and page.
COLOURS = {
    'blue': Colour('#003F74', '#1B85F5'),
    'sky': Colour('#1F96F7', '#7DCDFB'),
    'green': Colour('#18855F', '#427E52'),
    'vermillion': Colour('#A34D09', '#FFAFA4'),
    'purple': Colour('#936391', '#D66599'),
    'orange': Colour('#C68404', '#A79506'),
    'brown': Colour('#4C2A00', '#EAE657'),
    'ink': Colour('#222222', '#E8ECF1'),
}
#: Colours and dashes of a controller's terms, in the order in which it declares them.
TERMS = ('vermillion', 'purple', 'orange', 'brown')
TERM_DASHES = ((0.0, (8.0, 2.0)), (0.0, (2.0, 2.0)), (0.0, (8.0, 2.0, 2.0, 2.0)), (0.0, (4.0, 2.0)))
#: Colours of several runs in one figure.
RUN_COLOURS = tuple(
    COLOURS[name].light for name in ('blue', 'vermillion', 'green', 'purple', 'orange', 'sky')
)
#: Colour and dashes of each run; more runs than colours have the same colours with other dashes.
RUN_LINES = tuple((color, dashes) for dashes in ('-', (0.0, (3.0, 1.5))) for color in RUN_COLOURS)
BLUE = COLOURS['blue'].light
SKY = COLOURS['sky'].light
VERMILLION = COLOURS['vermillion'].light
GREEN = COLOURS['green'].light
INK = COLOURS['ink'].light
MUTED = '#6B6B6B'
GREY = '#9A9A9A'
EARTH = '#E4E1DA'
SURFACE = '#7D776A'

_Log = TypeVar('_Log', bound='Log')
#: Figures look the same with any matplotlibrc.
STYLE: list[str | dict[str, Any]] = [
    'default',
    {
        'font.size': 10,
        'text.parse_math': False,  # a bag's name can contain a dollar
        'text.color': INK,
        'axes.edgecolor': GREY,
        'axes.labelcolor': INK,
        'axes.spines.top': False,
        'axes.spines.right': False,
        'axes.axisbelow': True,
        'axes.grid': True,
        'grid.color': '#E9E9E9',
        'xtick.color': GREY,
        'ytick.color': GREY,
        'xtick.major.size': 3,
        'ytick.major.size': 3,
        'xtick.labelcolor': INK,
        'ytick.labelcolor': INK,
        'lines.solid_capstyle': 'round',
        'legend.frameon': False,
    },
]

DASHES = (0.0, (5.0, 3.0))


def style_sheet() -> str:
    """Return the palette as the page's style sheet: a variable and a class for each colour."""
    variables = [
        f'  --{name}: light-dark({colour.light}, {colour.dark});'
        for name, colour in COLOURS.items()
    ]
    terms = {f'term-{i}': name for i, name in enumerate(TERMS)}
    variables += [f'  --{term}: var(--{name});' for term, name in terms.items()]
    classes = [f'.line-{name} {{ --line: var(--{name}); }}' for name in (*COLOURS, *terms)]
    return '\n'.join([':root {', *variables, '}', *classes, ''])


def with_zero_for_unknown_errors(log: _Log) -> _Log:
    """Return the log with zero for unknown measurement errors, for figures.

    They draw the measurement where the true value is unknown: at the end of a killed run, and if
    the simulator publishes no errors.
    """
    errors = ('e_s', 'e_ey', 'e_epsi', 'e_v_x', 'e_v_y', 'e_psi_dot')
    return replace(log, **{name: np.nan_to_num(getattr(log, name)) for name in errors})


def driven_road(log: Log) -> Road | None:
    """Return the road that a run has driven; None if it recorded no grade.

    Each change of grade is placed halfway between two states.
    """
    recorded = np.flatnonzero(np.isfinite(log.theta_deg) & np.isfinite(log.distance))
    if not recorded.size:
        return None
    distance, first = np.unique(log.distance[recorded], return_index=True)
    grade = log.theta_deg[recorded][first]
    change = np.flatnonzero(np.diff(grade))
    starts = np.append(distance[0], (distance[change] + distance[change + 1]) / 2.0)
    grades = np.append(grade[0], grade[change + 1])
    has_length = np.append(np.diff(starts) > 0.0, True)
    return Road(starts[has_length], grades[has_length])


def limits(values: NDArray[np.float64], *, share: float, minimum: float) -> tuple[float, float]:
    """Return the limits of an axis around values and zero.

    Parameters
    ----------
    values
        What is drawn; NaN is left out.
    share
        By which share of their range the axis is wider at each end.
    minimum
        The least distance of the farther limit from zero.
    """
    finite = values[np.isfinite(values)]
    low = min(finite.min(initial=0.0), 0.0)
    high = max(finite.max(initial=0.0), 0.0)
    pad = max(share * (high - low), minimum - max(high, -low))
    return low - pad, high + pad


def after_run_up(log: Log, values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the values after the run-up, so that its large values do not set the limits.

    Return all values of a shorter run.
    """
    after = log.distance >= RUN_UP
    return values[..., after] if after.any() else values


def speed_limits(log: Log) -> tuple[float, float]:
    """Return limits around speed and reference after the run-up."""
    speeds = after_run_up(log, np.stack([log.speed, log.reference]))
    low = float(np.nanmin(speeds))
    high = float(np.nanmax(speeds))
    pad = max(0.1 * (high - low), 0.25)
    return low - pad, high + pad


def reading(value: float, digits: int, unit: str) -> str:
    """Return `value` as text with its unit; a dash for NaN."""
    if np.isnan(value):
        return '\N{EN DASH}'
    # Adding zero turns a negative zero into zero.
    return f'{round(value, digits) + 0.0:.{digits}f}{unit}'.replace('-', '\N{MINUS SIGN}')


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
