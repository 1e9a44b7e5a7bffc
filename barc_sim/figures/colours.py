"""The colours of figures and page, and the settings of Matplotlib that all figures have.

Nothing here imports Matplotlib: the live page starts without it.
"""

from __future__ import annotations

from typing import Any, NamedTuple


class Colour(NamedTuple):
    """A colour on a light background, as in figures, and on the page's dark background."""

    light: str
    dark: str


# Any two colours differ for readers with any colour blindness; each has a contrast of 3:1 with the
# background (tests/figures/test_colours.py). A colour has one meaning in figures and page.
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
