"""Colours differ for every reader, and contrast with both grounds."""

from __future__ import annotations

import re
from importlib import resources
from itertools import combinations

import pytest
from palette import READERS, contrast, difference

from barc_sim.figures.colours import COLOURS

CSS = (resources.files('barc_sim.page') / 'web' / 'view.css').read_text('utf-8')
GROUNDS = re.findall(r'--panel: light-dark\((#\w+), (#\w+)\)', CSS)[0]


def test_the_published_pairs_have_the_published_difference() -> None:
    assert difference('#FFFFFF', '#000000', 'any') == pytest.approx(100.0, abs=0.1)
    assert difference('#FF0000', '#00FF00', 'any') == pytest.approx(170.6, abs=0.1)


@pytest.mark.parametrize('reader', READERS)
@pytest.mark.parametrize('ground', [0, 1])
def test_any_two_colours_differ_for_every_reader(reader: str, ground: int) -> None:
    close = {
        (first, second): round(distance, 1)
        for first, second in combinations(COLOURS, 2)
        if (distance := difference(COLOURS[first][ground], COLOURS[second][ground], reader)) <= 18.0
    }
    assert close == {}


@pytest.mark.parametrize('name', COLOURS)
def test_each_colour_contrasts_with_both_grounds(name: str) -> None:
    for colour, ground in zip(COLOURS[name], GROUNDS, strict=True):
        assert contrast(colour, ground) >= 3.0
