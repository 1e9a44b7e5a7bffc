"""The racing line of a track, of least curvature, and the time of a lap at a planned speed."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

import numpy as np

from barc_sim.errors import UserError
from barc_sim.vehicle.track import Track

if TYPE_CHECKING:
    from collections.abc import Callable
    from os import PathLike
    from pathlib import Path

    from numpy.typing import NDArray

    Floats = NDArray[np.float64]

_MARGIN = 0.2  #: of the width
_SPACING = 0.5  #: [m] between two points of the line, as far as the least and most points allow
_LEAST, _MOST = 100, 800
_ROUNDS = 30
_SETTLED = 1e-3  #: [m] A round that moves the line less is the last.
_STEP = 0.05  #: [m] of the integral over a lap


def solver() -> Any:  # noqa: ANN401 (a module without types)
    """Return the module daqp, which solves quadratic programs; UserError: it is not there."""
    try:
        return import_module('daqp')
    except ImportError:
        raise UserError(
            "racing line and MPC need daqp, which is not installed: pip install 'barc_sim[mpc]'"
        ) from None


def racing_line(track: Track | str | PathLike[str] = 'L', *, margin: float | None = None) -> Track:
    """Return the line of least curvature on a closed track, itself a `Track` to drive on.

    The line minimises ∫ κ² dl, with the curvature κ over the length l of the line itself, and keeps
    `margin` [m] from both edges, a fifth of the width unless given. Each round of Gauss-Newton is a
    quadratic program for the offsets n from the centre line (Heilmeier et al., "Minimum curvature
    trajectory planning and control for an autonomous race car", Vehicle System Dynamics 58, 2020).

    Examples
    --------
    >>> from barc_sim import racing_line, speed_profile, Track
    >>> for track in (Track.named('L'), racing_line('L')):
    ...     print(f'{lap_time(track, speed_profile(track, 12.0, 3.5, 2.0)):.2f} s')
    25.38 s
    21.07 s
    """
    track = Track.of(track)
    half = 0.5 * track.width
    margin = _MARGIN * track.width if margin is None else margin
    if not track.is_closed:
        raise UserError(f'track {track.name!r} is not closed: a racing line is that of flying laps')
    if not 0.0 < margin < half:
        raise UserError(
            f'margin {margin!r} must be above 0 and below half of the width, {half:g} m'
        )
    n = min(max(round(track.length / _SPACING), _LEAST), _MOST)
    h = track.length / n
    centre = track.place(np.arange(n) * h)
    normal = -np.sin(centre.psi), np.cos(centre.psi)
    one = np.eye(n)
    ahead, behind = np.roll(one, 1, axis=1), np.roll(one, -1, axis=1)
    first, second = (ahead - behind) / (2.0 * h), (ahead - 2.0 * one + behind) / h**2
    bounds, none = np.full(n, half - margin), np.empty((0, n))
    offsets = np.zeros(n)
    solve = solver().solve
    for _ in range(_ROUNDS):
        x, y = (c + offsets * across for c, across in zip(centre[:2], normal, strict=True))
        residuals, jacobian = _bending(first, second, x, y, *normal)
        hessian = jacobian.T @ jacobian + 1e-9 * one
        gradient = jacobian.T @ (residuals - jacobian @ offsets)
        found, _, flag, _ = solve(hessian, gradient, none, bounds, -bounds)
        if flag < 1:
            raise UserError(f'no racing line of {track.name!r} was found: give another margin')
        found = np.clip(found, -bounds, bounds)
        moved, offsets = float(np.abs(found - offsets).max()), found
        if moved < _SETTLED:
            break
    x, y = (c + offsets * across for c, across in zip(centre[:2], normal, strict=True))
    width = 2.0 * (half - float(np.abs(offsets).max()))
    return Track.through(x.tolist(), y.tolist(), width, f'{track.name} racing line')


def _bending(
    first: Floats, second: Floats, x: Floats, y: Floats, u: Floats, v: Floats
) -> tuple[Floats, Floats]:
    """Return κ √(dl/ds) at points (x, y), and its derivatives by offsets along normals (u, v).

    `first` and `second` are the matrices that take the derivatives over s.
    """
    dx, dy, ddx, ddy = first @ x, first @ y, second @ x, second @ y
    speed = np.hypot(dx, dy)
    residuals = (dx * ddy - dy * ddx) / speed**2.5
    bend = dx[:, None] * (second * v) - dy[:, None] * (second * u)
    bend += ddy[:, None] * (first * u) - ddx[:, None] * (first * v)
    stretch = dx[:, None] * (first * u) + dy[:, None] * (first * v)
    return residuals, bend / speed[:, None] ** 2.5 - 2.5 * (residuals / speed**2)[:, None] * stretch


def lap_time(track: Track, speed: Callable[[float, float], float]) -> float:
    """Return the time [s] of a flying lap at `speed` [m/s], a function of time and place."""
    n = round(track.length / _STEP)
    step = track.length / n
    return sum(step / speed(0.0, (k + 0.5) * step) for k in range(n))


def write_line(
    path: Path, track: Track, line: Track, speed: Callable[[float, float], float]
) -> None:
    """Write a racing line as a file of a track: its points, the ways to the edges, and its speed.

    `Track.named` reads it, and so does what reads the files of the racetrack database.
    """
    s = np.array(line.starts[:-1:2])  # two arcs lead from point to point
    x, y, psi = map(np.asarray, line.place(s))
    e_y, half = np.asarray(track.frenet(x, y, psi).e_y), 0.5 * track.width
    planned = np.array([speed(0.0, each) for each in s.tolist()])
    columns = x, y, half + e_y, half - e_y, planned
    rows = (','.join(f'{float(each)!r}' for each in row) for row in zip(*columns, strict=True))
    text = '\n'.join(['x_m,y_m,w_tr_right_m,w_tr_left_m,speed_mps', *rows, ''])
    path.write_text(text, encoding='utf-8')
