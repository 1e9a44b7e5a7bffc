"""The road of a run on the map, from its recorded grade and elevation."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from barc_sim.simulation.log import Log

    Floats = NDArray[np.float64]

#: [m] The road continues by this on both sides of the driven part, at the same grade.
MARGIN = 60.0
#: [m] between the points at which the height of a wheel is computed.
RESOLUTION = 0.02
_MOST_POINTS = 2_000_000  # beyond 40 km the points are further apart


class Terrain:
    """Converts a distance along the road's surface to a place on the map.

    The horizontal distance is the integral of cos(theta) over the distance along the surface: 20 m
    at 10° are 19.696 m on the map. It is zero where the distance is zero.

    Attributes
    ----------
    distance, horizontal, elevation
        [m] the points of the road's surface, in rising order, each of shape `(m,)`; the road is
        straight between them.

    Examples
    --------
    >>> from barc_sim import simulate
    >>> horizontal, elevation = Terrain(simulate()).at(120.0)
    >>> round(float(elevation), 1)
    10.0
    """

    def __init__(self, log: Log) -> None:
        """Take the road from a run of at least one state; without a recorded road it is flat."""
        known = np.isfinite(log.theta_deg) & np.isfinite(log.elevation)
        rows = np.flatnonzero(known if known.any() else ~known)
        driven, first = np.unique(log.distance[rows], return_index=True)
        theta = np.radians(np.nan_to_num(log.theta_deg[rows][first]))
        theta = np.pad(theta, 1, mode='edge')
        elevation = np.nan_to_num(log.elevation[rows][first])
        before = elevation[0] - MARGIN * np.sin(theta[0])
        behind = elevation[-1] + MARGIN * np.sin(theta[-1])
        self.distance = np.concatenate([[driven[0] - MARGIN], driven, [driven[-1] + MARGIN]])
        self.elevation = np.concatenate([[before], elevation, [behind]])
        # A change of grade is somewhere between two states: each half has one of the grades.
        cosine = np.cos(theta)
        steps = np.diff(self.distance) * (cosine[:-1] + cosine[1:]) / 2.0
        horizontal = np.concatenate([[0.0], np.cumsum(steps)])
        self.horizontal = horizontal - np.interp(0.0, self.distance, horizontal)

    def at(self, distance: float | Floats) -> tuple[Floats, Floats]:
        """Return horizontal distance and elevation [m] of the road's surface at `distance`."""
        s = np.asarray(distance)
        return (
            np.interp(s, self.distance, self.horizontal),
            np.interp(s, self.distance, self.elevation),
        )

    def wheel_path(self, radius: float) -> tuple[Floats, Floats]:
        """Return the path of the centre of a wheel of `radius` [m] that rolls over the road.

        Returns
        -------
        horizontal, elevation
            [m], each of shape `(k,)`: the lowest places at which the wheel does not sink in.
        """
        resolution = max(RESOLUTION, float(np.ptp(self.horizontal)) / _MOST_POINTS)
        horizontal = np.arange(self.horizontal[0], self.horizontal[-1], resolution)
        offsets = np.arange(-radius, radius, RESOLUTION)
        elevation = np.full(horizontal.shape, -np.inf)
        for offset, above in zip(offsets, np.sqrt(radius**2 - offsets**2), strict=True):
            surface = np.interp(horizontal + offset, self.horizontal, self.elevation)
            np.maximum(elevation, surface + above, out=elevation)
        return horizontal, elevation
