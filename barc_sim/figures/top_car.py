"""The car from above, to scale: body, windows, lights, and front wheels that are turned."""

from __future__ import annotations

from typing import TYPE_CHECKING

from matplotlib.patches import FancyBboxPatch, Polygon, Rectangle
from matplotlib.transforms import Affine2D

from barc_sim.figures.side_car import AXLES, GLASS, LAMP
from barc_sim.figures.style import BLUE, INK, VERMILLION

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.transforms import Transform

# In metres from the centre of mass, x forward, y to the left.
REAR, FRONT, HALF_WIDTH = -2.2, 2.2, 0.88
ROUNDING = 0.35
WINDOWS = [
    [(0.95, 0.72), (0.3, 0.6), (0.3, -0.6), (0.95, -0.72)],
    [(-1.55, 0.62), (-1.1, 0.56), (-1.1, -0.56), (-1.55, -0.62)],
    [(0.75, 0.78), (0.2, 0.68), (-1.05, 0.64), (-1.35, 0.74)],
    [(0.75, -0.78), (0.2, -0.68), (-1.05, -0.64), (-1.35, -0.74)],
]
LIGHTS = [
    ([(2.05, 0.75), (2.19, 0.6), (2.19, 0.4), (2.08, 0.5)], LAMP),
    ([(-2.19, 0.7), (-2.12, 0.7), (-2.12, 0.35), (-2.19, 0.35)], VERMILLION),
]
TRACK = 0.86  #: [m] from the middle to a wheel
WHEEL = (0.7, 0.26)  #: [m] length and width


class TopCar:
    """Artists of a car that is placed by heading and steering, in the middle of its axes.

    Attributes
    ----------
    artists
        All of them, in the order of drawing.
    """

    def __init__(self, axes: Axes) -> None:
        """Add the car to `axes`, whose two scales, in metres, are equal."""
        self._body = Affine2D()
        self._front = [Affine2D() for _ in (-1, 1)]
        body = self._body + axes.transData
        rear, front = AXLES
        mirrored = [([(x, -y) for x, y in points], color) for points, color in LIGHTS]
        self.artists: list[Artist] = [
            *(_wheel(Affine2D().translate(rear, side * TRACK) + body) for side in (-1, 1)),
            *(_wheel(wheel + body) for wheel in self._front),
            FancyBboxPatch(
                (REAR + ROUNDING, -HALF_WIDTH + ROUNDING),
                FRONT - REAR - 2.0 * ROUNDING,
                2.0 * (HALF_WIDTH - ROUNDING),
                boxstyle=f'round,pad={ROUNDING}',
                facecolor=BLUE,
                edgecolor=INK,
                lw=1.0,
                transform=body,
            ),
            *(Polygon(points, facecolor=GLASS, transform=body) for points in WINDOWS),
            *(
                Polygon(points, facecolor=color, transform=body)
                for points, color in [*LIGHTS, *mirrored]
            ),
        ]
        self._axle = front
        for artist in self.artists:
            axes.add_artist(artist)

    def place(self, psi: float, servo: float) -> None:
        """Turn the car to heading `psi` [rad], and its front wheels by `servo` [rad]."""
        self._body.clear().rotate(psi)
        for side, wheel in zip((-1, 1), self._front, strict=True):
            wheel.clear().rotate(servo).translate(self._axle, side * TRACK)


def _wheel(transform: Transform) -> Rectangle:
    length, width = WHEEL
    return Rectangle(
        (-length / 2.0, -width / 2.0), length, width, facecolor=INK, transform=transform
    )
