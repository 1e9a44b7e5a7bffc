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
    seen = np.clip(READERS[reader] @ linear(colour), 0.0, 1.0)
    share = (_XYZ @ seen) / _XYZ.sum(axis=1)
    f = np.where(share > 216 / 24389, np.cbrt(share), (24389 / 27 * share + 16) / 116)
    return np.array([116 * f[1] - 16, 500 * (f[0] - f[1]), 200 * (f[1] - f[2])])


def difference(one: str, other: str, reader: str) -> float:
    """Return the difference CIEDE2000 of two colours, as a reader sees them."""
    (l_1, a_1, b_1), (l_2, a_2, b_2) = lab(one, reader), lab(other, reader)
    mean = (np.hypot(a_1, b_1) + np.hypot(a_2, b_2)) / 2
    grey = 1.5 - 0.5 * np.sqrt(mean**7 / (mean**7 + 25.0**7))
    c_1, c_2 = np.hypot(a_1 * grey, b_1), np.hypot(a_2 * grey, b_2)
    h_1, h_2 = (np.degrees(np.arctan2(b, a * grey)) % 360 for a, b in ((a_1, b_1), (a_2, b_2)))
    turn = (h_2 - h_1 + 180) % 360 - 180
    lightness, c, h = (l_1 + l_2) / 2, (c_1 + c_2) / 2, (h_1 + turn / 2) % 360
    t = (
        1
        - 0.17 * np.cos(np.radians(h - 30))
        + 0.24 * np.cos(np.radians(2 * h))
        + 0.32 * np.cos(np.radians(3 * h + 6))
        - 0.20 * np.cos(np.radians(4 * h - 63))
    )
    parts = np.array(
        [
            (l_2 - l_1) / (1 + 0.015 * (lightness - 50) ** 2 / np.sqrt(20 + (lightness - 50) ** 2)),
            (c_2 - c_1) / (1 + 0.045 * c),
            2 * np.sqrt(c_1 * c_2) * np.sin(np.radians(turn / 2)) / (1 + 0.015 * c * t),
        ]
    )
    rotation = -np.sin(np.radians(60 * np.exp(-(((h - 275) / 25) ** 2)))) * 2
    rotation *= np.sqrt(c**7 / (c**7 + 25.0**7))
    return float(np.sqrt(parts @ parts + rotation * parts[1] * parts[2]))
