"""The one palette of figures and page: Okabe and Ito's, and which quantity has which colour."""

from __future__ import annotations

from typing import NamedTuple


class Colour(NamedTuple):
    """A colour on light ground, as in every figure, and on dark ground, as the page may have."""

    light: str
    dark: str


# Colour-blind readers can distinguish them. Lines of a quantity contrast with white by 3:1.
COLOURS = {
    'blue': Colour('#0072B2', '#56B4E9'),
    'sky': Colour('#56B4E9', '#8ECDF2'),
    'green': Colour('#009E73', '#3CCB9F'),
    'vermillion': Colour('#D55E00', '#FF8A4A'),
    'purple': Colour('#A8457F', '#DD97BB'),
    'orange': Colour('#B07A00', '#E69F00'),
    'ink': Colour('#222222', '#E8ECF1'),
}
#: Names in `COLOURS` by the column of a log.
QUANTITIES = {'speed': 'blue', 'v_x': 'sky', 'reference': 'ink', 'motor': 'green'}
#: Of a controller's terms, in the order in which it declares them.
TERMS = ('vermillion', 'purple', 'orange', 'sky')
#: Of the forces on the car; the motor's is that of its command.
FORCES = {'motor': 'green', 'gravity': 'purple', 'drag': 'sky', 'friction': 'vermillion'}


def term_colours(terms: tuple[str, ...]) -> dict[str, str]:
    """Return the name of each term's colour."""
    return {term: TERMS[i % len(TERMS)] for i, term in enumerate(terms)}


def style_sheet() -> str:
    """Return the palette as the page's style sheet: a variable and a class for each colour."""
    variables = [
        f'  --{name}: light-dark({colour.light}, {colour.dark});'
        for name, colour in COLOURS.items()
    ]
    classes = [f'.line-{name} {{ --line: var(--{name}); }}' for name in COLOURS]
    return '\n'.join([':root {', *variables, '}', *classes, ''])
