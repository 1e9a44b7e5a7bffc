"""Types of options: what they take, and how they refuse."""

from __future__ import annotations

from argparse import ArgumentTypeError

import pytest

from barc_sim.cli.option_types import number, whole


@pytest.mark.parametrize('text', ['-1', '0', '2.5e0', '3'])
def test_number_within_its_bounds_is_taken(text: str) -> None:
    assert number(-1.0, 3.0)(text) == float(text)


@pytest.mark.parametrize('text', ['-1.001', '3.1', 'nan', 'inf', 'three', ''])
def test_other_number_is_refused(text: str) -> None:
    with pytest.raises(ArgumentTypeError, match=f'{text!r} is not a number from -1 to 3'):
        number(-1.0, 3.0)(text)


@pytest.mark.parametrize('text', ['1', '7', '10'])
def test_whole_number_within_its_bounds_is_taken(text: str) -> None:
    assert whole(1, 10)(text) == int(text)


@pytest.mark.parametrize('text', ['0', '11', '1.0', '-1', '+1', '', 'one'])
def test_other_whole_number_is_refused(text: str) -> None:
    with pytest.raises(ArgumentTypeError, match='is not a whole number from 1 to 10'):
        whole(1, 10)(text)
