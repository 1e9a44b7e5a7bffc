"""Plans by quadratic programs: the racing line of a track, and the next metres of an MPC.

The MPC's errors are predicted over the distance along the centre line, not over time: then their
model is the same at every speed, and so are the weights. With κ of the centre line, the actual
angle δ, its steady turn δ(κ), e_psi(κ), and λ = v · lag, for a distance s::

    e_y' = e_psi - e_psi(κ) + (l_r / L)(δ - δ(κ))    e_psi' = (δ - δ(κ)) / L    δ' = (u - δ) / λ

The commands that have not acted yet predict the errors where the next command acts (a Smith
predictor). From there on, in steps of `step` metres with a constant u, the program minimises::

    Σ step (q_e_y e_y² + q_e_psi (e_psi - e_psi(κ))² + (u - δ(κ))²) + q_change Σ (u - u before)²

with the limits of the angle and of its rate. The terminal cost is that of the LQR, from the
algebraic Riccati equation: without active limits, lag and weight of the change, the first command
equals the LQR's (Rawlings, Mayne, Diehl, "Model Predictive Control", 2.5).

The model assumes the present speed for the whole plan.
"""

from __future__ import annotations

from functools import lru_cache
from math import exp
from typing import TYPE_CHECKING, Any

import numpy as np

from barc_sim.cli.packages import extra
from barc_sim.control.lane import speed_profile
from barc_sim.errors import UserError
from barc_sim.vehicle.track import RACING_LINE, Track

if TYPE_CHECKING:
    from os import PathLike
    from pathlib import Path

    from numpy.typing import NDArray

    Floats = NDArray[np.float64]
    #: Maximum speed [m/s], and maximum lateral and longitudinal acceleration [m/s²].
    Limits = tuple[float, float, float]

_MARGIN = 0.2  #: of the width
_SPACING = 0.5  #: [m] between two points of the line, within the limits of their number
_MIN_POINTS = 100
_MAX_POINTS = 800
_ROUNDS = 30
_SETTLED = 1e-3  #: [m] A round that moves the line less is the last.
_STEP = 0.05  #: [m] of the integral over a lap
HORIZON = 20  #: steps of an MPC
_ONE = np.eye(HORIZON)
CHANGE = _ONE - np.eye(HORIZON, k=-1)  #: takes a plan's commands to the changes between them


def solver() -> Any:  # noqa: ANN401 (a function without types)
    """Return daqp's solver of quadratic programs; UserError: it is not installed."""
    return extra('daqp', 'a racing line or an MPC', 'mpc').solve


def racing_line(track: Track | str | PathLike[str] = 'L', *, margin: float | None = None) -> Track:
    """Return the minimum-curvature line of a closed track, as a `Track` to drive on.

    The line minimises ∫ κ² dl, with the curvature κ over the length l of the line itself, and keeps
    `margin` [m] from both edges, by default a fifth of the width. Each Gauss-Newton iteration is a
    quadratic program for the offsets n from the centre line (Heilmeier et al., "Minimum curvature
    trajectory planning and control for an autonomous race car", Vehicle System Dynamics 58, 2020).

    Parameters
    ----------
    track
        A closed track, the name of one, or the path of its CSV file.
    margin
        [m] from both edges.

    Returns
    -------
    Track
        The line, as wide as both edges allow.

    Raises
    ------
    UserError
        if the track is not closed, the margin leaves no room, or daqp is not installed.

    Examples
    --------
    >>> from barc_sim import racing_line, Track
    >>> from barc_sim.control.planning import lap_time
    >>> for track in (Track.named('L'), racing_line('L')):
    ...     print(f'{lap_time(track, (12.0, 3.5, 2.0)):.2f} s')
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

    n = min(max(round(track.length / _SPACING), _MIN_POINTS), _MAX_POINTS)
    h = track.length / n
    places = track.place(h * np.arange(n))
    # Vectors are complex: conj(a) b has their dot product, and as the imaginary part their cross
    # product.
    centre = np.asarray(places.x) + 1j * np.asarray(places.y)
    normals = 1j * np.exp(1j * np.asarray(places.psi))

    # The derivatives of the line over s are linear in the offsets.
    identity = np.eye(n)
    ahead = np.roll(identity, 1, axis=1)
    behind = np.roll(identity, -1, axis=1)
    first = (ahead - behind) / (2.0 * h)
    second = (ahead - 2.0 * identity + behind) / h**2

    bounds = np.full(n, half - margin)
    offsets = np.zeros(n)
    solve = solver()
    for _ in range(_ROUNDS):
        line = centre + offsets * normals
        along = (first @ line)[:, None]
        bend = (second @ line)[:, None]
        weight = np.abs(along) ** -2.5
        residuals = weight * (along.conj() * bend).imag  # κ √(dl/ds)

        across = (first * normals).conj() * bend + along.conj() * (second * normals)
        stretch = (along.conj() * (first * normals)).real / np.abs(along) ** 2
        jacobian = weight * across.imag - 2.5 * residuals * stretch
        hessian = jacobian.T @ jacobian + 1e-9 * identity
        gradient = jacobian.T @ (residuals[:, 0] - jacobian @ offsets)
        solution, _, flag, _ = solve(hessian, gradient, np.empty((0, n)), bounds, -bounds)
        if flag < 1:
            raise UserError(f'no racing line of {track.name!r} was found: give another margin')

        solution = np.clip(solution, -bounds, bounds)
        change = float(np.abs(solution - offsets).max())
        offsets = solution
        if change < _SETTLED:
            break
    return line_beside(track, offsets)


def line_beside(track: Track, offsets: Floats) -> Track:
    """Return the closed line through points `offsets` [m] to the left of the centre line.

    The points have equal spacing along the centre line, from its start. The line is as wide as
    both edges allow.
    """
    s = track.length / len(offsets) * np.arange(len(offsets))
    places = track.place(s, offsets)
    width = track.width - 2.0 * float(np.abs(offsets).max())
    return Track.through(
        np.asarray(places.x), np.asarray(places.y), width, f'{track.name} racing line'
    )


def bending(track: Track) -> float:
    """Return the integral of the squared curvature over a track [1/m]."""
    return sum(k * k * length for k, length in zip(track.curvatures, track.lengths, strict=True))


def lap_time(track: Track, limits: Limits) -> float:
    """Return the time [s] of a flying lap, as fast as `limits` of `speed_profile` allow."""
    n = round(track.length / _STEP)
    speed = speed_profile(track, *limits)
    step = track.length / n
    return sum(step / speed(0.0, (k + 0.5) * step) for k in range(n))


def write_line(path: Path, track: Track, line: Track, limits: Limits) -> None:
    """Write a racing line as a track file: its points, the distances to the edges, and its speed.

    `Track.named` reads it, and so do programs for the files of the racetrack database.
    """
    s = np.array(line.starts[:-1:2])  # two arcs lead from point to point
    places = line.place(s)
    near = track.length / len(s) * np.arange(len(s))  # as the points of `line_beside`
    e_y = np.asarray(track.frenet(places.x, places.y, places.psi, near).e_y)
    half = 0.5 * track.width
    profile = speed_profile(line, *limits)
    speeds = np.array([profile(0.0, each) for each in s.tolist()])
    rows = np.column_stack([places.x, places.y, half + e_y, half - e_y, speeds])
    np.savetxt(path, rows, '%.17g', ',', header=RACING_LINE, comments='')


@lru_cache(256)
def program(
    distance: float, step: float, weights: tuple[float, float, float], l_f: float, l_r: float
) -> tuple[Floats, Floats, Floats]:
    """Return the Hessian, and the matrices of the gradient and of e_y after each step.

    `distance` [m] is λ. The gradient is linear in e_y, e_psi and δ at the start, and in the steady
    turn and its heading in each step; e_y is linear in these and in the commands.
    """
    n = HORIZON
    length = l_f + l_r
    q_e_y, q_e_psi, q_change = weights

    # What a step does to e_y, e_psi and δ.
    left = exp(-step / distance) if distance else 0.0
    once = distance * (1.0 - left)  # integral of what is left of the angle
    by_angle = (l_r * once + distance * (step - once)) / length, once / length, left
    matrix = np.array([[1.0, step, by_angle[0]], [0.0, 1.0, by_angle[1]], [0.0, 0.0, left]])
    by_track = np.array([l_r + 0.5 * step, 1.0, 0.0]) * (step / length)
    by_command = by_track - by_angle + (0.0, 0.0, 1.0)

    # The states are linear in the commands, the start, and the steady turns and their headings:
    # these are the columns, in this order.
    columns = 3 * n + 3
    steer = n + 3  # first column of the steady turns
    heading = 2 * n + 3  # first column of their headings
    now = np.eye(3, columns, n)
    path = np.empty((2, n, columns))
    for k in range(n):
        now = matrix @ now
        now[:, k] += by_command
        now[:, steer + k] -= by_track
        now[0, heading + k] -= step
        path[:, k] = now[:2]
        path[1, k, heading + min(k + 1, n - 1)] -= 1.0

    weighted = step * np.array([[[q_e_y]], [[q_e_psi]]]) * path
    weighted[:, -1] = cost_to_go(q_e_y, q_e_psi, step, length, l_r) @ path[:, -1]
    by_all = path[:, :, :n].reshape(-1, n).T @ weighted.reshape(2 * n, -1)
    by_all[:, :n] += step * _ONE + q_change * CHANGE.T @ CHANGE
    by_all[:, steer:heading] -= step * _ONE
    return by_all[:, :n].copy(), by_all[:, n:].copy(), path[0]


@lru_cache(8)
def cost_to_go(q_e_y: float, q_e_psi: float, step: float, length: float, l_r: float) -> Floats:
    """Return the matrix of the terminal cost of e_y and e_psi, without lag.

    It solves the discrete algebraic Riccati equation, by doubling (Chu, Fan, Lin, Wang, Int. J.
    Control 77, 2004).
    """
    identity = np.eye(2)
    a = np.array([[1.0, step], [0.0, 1.0]])
    b = step / length * np.array([[l_r + 0.5 * step], [1.0]])
    g = b @ b.T / step
    h = step * np.diag([q_e_y, q_e_psi])
    change = identity
    while np.abs(change).max() > 1e-14 * np.abs(h).max():
        inverse = np.linalg.inv(identity + g @ h)
        change = a.T @ h @ inverse @ a
        g = g + a @ inverse @ g @ a.T
        h = h + change
        a = a @ inverse @ a
    return h
