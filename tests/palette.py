"""Colours as readers see them: contrast, and differences for each kind of colour blindness."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
#: Linear RGB as seen: Machado, Oliveira and Fernandes (2009), full severity.
READERS = {
    'any': np.eye(3),
    'protanopia': np.array(
        [
            [0.152286, 1.052583, -0.204868],
            [0.114503, 0.786281, 0.099216],
            [-0.003882, -0.048116, 1.051998],
        ]
    ),
    'deuteranopia': np.array(
        [
            [0.367322, 0.860646, -0.227968],
            [0.280085, 0.672501, 0.047413],
            [-0.011820, 0.042940, 0.968881],
        ]
    ),
    'tritanopia': np.array(
        [
            [1.255528, -0.076749, -0.178779],
            [-0.078411, 0.930809, 0.147602],
            [0.004733, 0.691367, 0.303900],
        ]
    ),
}
_XYZ = np.array(
    [
        [0.4124564, 0.3575761, 0.1804375],
        [0.2126729, 0.7151522, 0.0721750],
        [0.0193339, 0.1191920, 0.9503041],
    ]
)


def linear(colour: str) -> Floats:
    """Return the linear RGB of a colour such as '#003F74'."""
    rgb = np.array([int(colour[i : i + 2], 16) / 255.0 for i in (1, 3, 5)])
    return np.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4)


def contrast(colour: str, ground: str) -> float:
    """Return the contrast of WCAG, from 1 to 21."""
    low, high = sorted(float(_XYZ[1] @ linear(each)) for each in (colour, ground))
    return (high + 0.05) / (low + 0.05)


def lab(colour: str, reader: str) -> Floats:
    """Return the colour in CIELAB, as a reader sees it."""
    visible = np.clip(READERS[reader] @ linear(colour), 0.0, 1.0)
    share = (_XYZ @ visible) / _XYZ.sum(axis=1)
    f = np.where(share > 216 / 24389, np.cbrt(share), (24389 / 27 * share + 16) / 116)
    return np.array([116 * f[1] - 16, 500 * (f[0] - f[1]), 200 * (f[1] - f[2])])


def difference(first: str, second: str, reader: str) -> float:
    """Return how far two colours are apart in CIELAB, as a reader sees them."""
    return float(np.linalg.norm(lab(first, reader) - lab(second, reader)))
