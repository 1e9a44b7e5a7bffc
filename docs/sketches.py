"""Sketches of these pages: the bicycle of the derivation, and the forces on a hill."""

from __future__ import annotations

from math import atan, cos, radians, sin, tan
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Arc, FancyArrowPatch, Rectangle
from matplotlib.transforms import Affine2D

from barc_sim.figures.colours import BLUE, DASHES, EARTH, GREEN, GREY, INK, MUTED, SURFACE
from barc_sim.figures.colours import VERMILLION as RED

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from numpy.typing import NDArray

    Vector = NDArray[np.float64]  #: x and y


def _empty_axes(figure: Figure) -> Axes:
    """Return axes without a frame that fill the figure, with the same scale on both."""
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    axes.set_aspect('equal')
    axes.axis('off')
    return axes


def _direction(angle: float) -> Vector:
    """Return the unit vector at an angle [rad]."""
    return np.array([cos(angle), sin(angle)])


class _Sketch:
    """Draws the lines, wheels and angles of the bicycle's derivation."""

    def __init__(self, axes: Axes) -> None:
        self._axes = axes

    def line(self, begin: Vector, end: Vector, colour: str = INK, **options: Any) -> None:
        xs = [begin[0], end[0]]
        ys = [begin[1], end[1]]
        self._axes.plot(xs, ys, color=colour, **{'lw': 1.4} | options)

    def guide(self, begin: Vector, end: Vector) -> None:
        """Draw a thin dashed line."""
        self.line(begin, end, GREY, ls=DASHES, lw=1.0)

    def wheel(self, centre: Vector, angle: float) -> None:
        transform = Affine2D().rotate(angle).translate(*centre) + self._axes.transData
        wheel = Rectangle((-0.5, -0.15), 1.0, 0.3, color=SURFACE, transform=transform, zorder=3)
        self._axes.add_patch(wheel)

    def arc(self, centre: Vector, radius: float, angles: tuple[float, float], name: str) -> None:
        """Draw an arc between two angles [rad], and its name in the middle of it."""
        theta_1, theta_2 = np.degrees(angles)
        diameter = 2 * radius
        arc = Arc(centre, diameter, diameter, theta1=theta_1, theta2=theta_2, color=RED, lw=1.3)
        self._axes.add_patch(arc)

        middle = 0.5 * (angles[0] + angles[1])
        place = centre + (radius + 0.28) * _direction(middle)
        self._axes.text(*place, name, color=RED, ha='center', va='center', fontsize=13)

    def arrow(self, begin: Vector, end: Vector, colour: str, **options: Any) -> None:
        arrow = FancyArrowPatch(begin, end, color=colour, shrinkA=0, shrinkB=0, **options)
        self._axes.add_patch(arrow)

    def length(self, begin: Vector, end: Vector, offset: Vector, name: str) -> None:
        """Draw a double arrow beside a line, and the name of its length."""
        self.arrow(begin + offset, end + offset, MUTED, arrowstyle='<->', mutation_scale=9)
        place = 0.5 * (begin + end) + 1.75 * offset
        options = {'color': MUTED, 'fontsize': 13, 'ha': 'center', 'va': 'center'}
        self._axes.text(*place, name, parse_math=True, **options)


def bicycle() -> Figure:
    """Draw the kinematic bicycle with every angle and length of the derivation."""
    figure = Figure(figsize=(7.2, 4.6))
    axes = _empty_axes(figure)
    sketch = _Sketch(axes)

    psi = radians(20.0)
    d_f = radians(32.0)
    l_f = 2.2
    l_r = 2.2
    beta = atan(l_r / (l_f + l_r) * tan(d_f))

    along = _direction(psi)
    across = np.array([-sin(psi), cos(psi)])
    rear = np.zeros(2)
    front = (l_f + l_r) * along
    centre = l_r * along
    icr = (l_f + l_r) / tan(d_f) * across

    # The bicycle, and its radii to the centre of rotation.
    for point in (rear, front, centre):
        sketch.guide(point, icr)
    sketch.line(rear, front, INK, lw=2.4)
    sketch.wheel(rear, psi)
    sketch.wheel(front, psi + d_f)

    # The directions, the speed and the angles between them.
    sketch.line(centre, centre + np.array([3.0, 0.0]), GREY, lw=1.0)
    sketch.guide(centre, centre + 3.2 * along)
    sketch.guide(front, front + 1.7 * along)
    sketch.guide(front, front + 1.7 * _direction(psi + d_f))
    speed = _direction(psi + beta)
    arrow_style = {'lw': 2.2, 'mutation_scale': 16, 'arrowstyle': '-|>', 'zorder': 4}
    sketch.arrow(centre, centre + 2.6 * speed, BLUE, **arrow_style)
    axes.text(*(centre + 2.8 * speed), 'v', color=BLUE, fontsize=14, style='italic')
    sketch.arc(centre, 2.35, (0.0, psi), 'ψ')
    sketch.arc(centre, 1.5, (psi, psi + beta), 'β')
    sketch.arc(front, 1.35, (psi, psi + d_f), 'δ')

    # The points and the lengths.
    axes.plot(*centre, 'o', color=INK, ms=6, zorder=5)
    axes.plot(*icr, 'o', color=GREEN, ms=6)
    axes.text(icr[0] - 0.2, icr[1] + 0.1, 'O', color=GREEN, fontsize=13, ha='right')
    below = -0.45 * across
    sketch.length(rear, centre, below, r'$l_r$')
    sketch.length(centre, front, below, r'$l_f$')
    axes.text(*(0.5 * (icr + centre) + [-0.15, 0.1]), 'R', color=MUTED, fontsize=13, ha='right')
    axes.text(*(centre - [0.1, 0.45]), 'C', color=INK, fontsize=12)

    axes.autoscale_view()
    axes.set_xlim(-3.2, 7.4)
    axes.set_ylim(-1.4, 7.2)
    figure.set_size_inches(7.2, 5.8)
    return figure


def forces_on_the_hill() -> Figure:
    """Draw the forces along the road on an incline."""
    figure = Figure(figsize=(6.4, 3.2))
    axes = _empty_axes(figure)
    theta = radians(16.0)
    along = _direction(theta)
    up = np.array([-sin(theta), cos(theta)])

    # The hill and the car.
    low = -3.4 * tan(theta)
    axes.fill([-3.4, 4.6, 4.6], [low, 4.6 * tan(theta), low], color=EARTH, zorder=0)
    transform = Affine2D().rotate(theta).translate(*(0.18 * up)) + axes.transData
    axes.add_patch(Rectangle((-1.0, 0.1), 2.0, 0.55, color=SURFACE, transform=transform))

    def force(begin: Vector, vector: Vector, colour: str, name: str, place: Vector) -> None:
        """Draw an arrow, and its name at a place relative to where it begins."""
        arrow = FancyArrowPatch(
            begin,
            begin + vector,
            color=colour,
            lw=2.0,
            arrowstyle='-|>',
            mutation_scale=15,
            shrinkA=0,
            shrinkB=0,
            zorder=4,
        )
        axes.add_patch(arrow)
        axes.text(*(begin + place), name, color=colour, fontsize=12, parse_math=True)

    middle = 0.5 * up
    front = middle + 1.0 * along
    rear = middle - 1.0 * along
    force(front, 1.5 * along, BLUE, '$m\\,a$', 1.1 * along + 0.28 * up)
    force(rear, -1.6 * along, RED, '$m\\,g\\,\\sin\\theta$', -2.1 * along + 0.3 * up)
    force(rear - 0.32 * up, -0.9 * along, GREEN, '$a_0 v^2 + F_f$', np.array([-0.45, -0.62]))
    force(middle, np.array([0.0, -1.7]), MUTED, '$m\\,g$', np.array([0.12, -1.55]))

    corner = np.array([-3.4, low])
    axes.add_patch(Arc(corner, 2.4, 2.4, theta1=0.0, theta2=16.0, color=INK, lw=1.2))
    axes.text(*(corner + np.array([1.3, 0.12])), 'θ', color=INK, fontsize=13)
    axes.set_xlim(-3.8, 4.8)
    axes.set_ylim(-1.45, 2.5)
    return figure
