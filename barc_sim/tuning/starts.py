"""Where the fit of `identify` begins: values near each minimum of its error, by a coarse search.

Over half a second in motion the speed changes by what was commanded, less drag and friction. So for
each delay and lag of a grid both are found by linear regression, without a prediction.
"""

from __future__ import annotations

from itertools import product
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from barc_sim.tuning.prediction import AT_REST, Stretch, respond
from barc_sim.vehicle.plant import Actuator

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from barc_sim.simulation.log import Floats
    from barc_sim.vehicle.bike_model import Vehicle

    Rows = NDArray[np.intp]

_WINDOW = 0.5  #: [s]
_MAX_WINDOWS = 2000  #: of a stretch
_STEP = 0.02  #: [s] between the commands before the first state
#: [s] the grid.
_DELAYS = np.append(np.arange(0.0, 0.3, 0.02), np.arange(0.3, 1.01, 0.05))
_LAGS = (0.0, 0.03, 0.06, 0.1, 0.15, 0.2, 0.3, 0.45, 0.65, 0.9, 1.3)
_COUNT = 3  #: of starts with a lag, and of starts without


class MotorStart(NamedTuple):
    """Resistance and motor at which a fit begins."""

    drag_per_mass: float = 0.0  #: [1/m]
    friction_per_mass: float = 0.0  #: [m/s²]
    motor_delay: float = 0.1  #: [s]
    motor_lag: float = 0.05  #: [s]


class _Windows(NamedTuple):
    """The windows of a stretch in which the car moves; arrays of shape `(n,)`."""

    first: Rows  #: row of the stretch
    last: Rows
    speed: Floats  #: [m/s] its change, without that by gravity
    square: Floats  #: [m²/s] integral of the squared speed
    time: Floats  #: [s]


def motor_starts(
    stretches: Sequence[Stretch], vehicle: Vehicle
) -> tuple[list[MotorStart], list[MotorStart]]:
    """Return the best starts with a lag, and without one."""
    windows = [_windows(stretch, vehicle) for stretch in stretches]
    speed, square, time = _changes(windows)
    if not len(speed):
        return [MotorStart()], [MotorStart(motor_lag=0.0)]

    regressors = -np.column_stack([square, time])
    inverse = np.linalg.pinv(regressors)
    costs = np.empty((len(_LAGS), len(_DELAYS)))
    resistances = np.empty((*costs.shape, 2))
    for i, lag in enumerate(_LAGS):
        rest = speed - _all_commanded(stretches, windows, lag)
        resistances[i] = rest @ inverse.T
        costs[i] = np.sum((rest - resistances[i] @ regressors.T) ** 2, 1)

    def start(i: int, j: int) -> MotorStart:
        drag, friction = np.maximum(resistances[i, j], 0.0).tolist()
        return MotorStart(drag, friction, float(_DELAYS[j]), _LAGS[i])

    with_lag = [start(i + 1, j) for i, j in _minima(costs[1:])]
    without = [start(0, j) for _, j in _minima(costs[:1])]
    return with_lag[:_COUNT], without[:_COUNT]


def gain_of(stretches: Sequence[Stretch], vehicle: Vehicle) -> float:
    """Return how many times as much as commanded the speed changes; 1 if the car never moves.

    It is not 1 where speed or command has another unit.
    """
    windows = [_windows(stretch, vehicle) for stretch in stretches]
    speed, square, time = _changes(windows)
    if not len(speed):
        return 1.0

    minimum = np.inf
    gain = 1.0
    for lag in _LAGS:
        for way in _all_commanded(stretches, windows, lag):
            regressors = np.column_stack([way, square, time])
            factors = np.linalg.lstsq(regressors, speed, rcond=None)[0]
            error = float(np.sum((speed - regressors @ factors) ** 2))
            if error < minimum:
                minimum = error
                gain = float(factors[0])
    return gain


def _changes(windows: Sequence[_Windows]) -> tuple[Floats, Floats, Floats]:
    """Return `speed`, `square` and `time` of the windows of all stretches."""
    return (
        np.concatenate([each.speed for each in windows]),
        np.concatenate([each.square for each in windows]),
        np.concatenate([each.time for each in windows]),
    )


def _all_commanded(stretches: Sequence[Stretch], windows: Sequence[_Windows], lag: float) -> Floats:
    """Return what `_commanded` does, in the windows of all stretches."""
    pairs = zip(stretches, windows, strict=True)
    return np.concatenate([_commanded(stretch, of_it, lag) for stretch, of_it in pairs], axis=1)


def servo_delay_start(stretches: Sequence[Stretch], vehicle: Vehicle) -> float:
    """Return the delay [s] with which the yaw rate follows speed and steering angle best."""
    length = vehicle.l_f + vehicle.l_r

    def error(delay: float) -> float:
        """Return the error of the yaw rate; a car that slips turns more, or less, by a factor."""
        turns = []
        rates = []
        for stretch in stretches:
            speed, rate, _ = stretch.measured[:, stretch.counted]
            angle = stretch.servo.at(stretch.t[stretch.counted] - delay)
            turns.append(speed * np.tan(angle) / length)
            rates.append(rate)

        turn = np.concatenate(turns)
        rate = np.concatenate(rates)
        factor = (turn @ rate) / ((turn @ turn) or 1.0)
        return float(np.sum((rate - factor * turn) ** 2))

    delays: list[float] = _DELAYS.tolist()
    return min(delays, key=error)


def _windows(stretch: Stretch, vehicle: Vehicle) -> _Windows:
    """Return the windows of a stretch."""
    rows = stretch.counted
    t = stretch.t
    speed = np.interp(t, t[rows], stretch.measured[0, rows])
    span = max(round(_WINDOW * (len(rows) - 1) / (t[rows[-1]] - t[rows[0]])), 1)
    every = max(len(rows) // _MAX_WINDOWS, 1)
    first = rows[:-span][::every]
    last = rows[span:][::every]

    # Only those in which the car does not stand.
    stands = _integral(np.abs(speed) < AT_REST, np.ones(len(t) - 1))
    in_motion = stands[last] == stands[first]
    first = first[in_motion]
    last = last[in_motion]

    steps = np.diff(t)
    forwards = np.sign(speed)
    gravity = _integral(-vehicle.gravity * stretch.sines, steps)
    square = _integral(forwards * speed**2, steps)
    time = _integral(forwards, steps)
    return _Windows(
        first,
        last,
        (speed - gravity)[last] - (speed - gravity)[first],
        square[last] - square[first],
        time[last] - time[first],
    )


def _integral(values: Floats, steps: Floats) -> Floats:
    """Return the integral of values that hold over each step, at each step's begin."""
    return np.append(0.0, np.cumsum(values[:-1] * steps))


def _commanded(stretch: Stretch, windows: _Windows, lag: float) -> Floats:
    """Return the commanded change of the speed [m/s] in each window, a row for each delay."""
    before = np.arange(-_DELAYS[-1], 0.0, _STEP)
    t = np.append(np.round(stretch.t[0] + before, 9), stretch.t)
    _, motor = respond(Actuator(lag=lag), stretch.motor, t, is_start=stretch.is_start)
    way = np.append(0.0, np.cumsum(motor * np.diff(t)))
    ways = np.array([np.interp(stretch.t - delay, t, way) for delay in _DELAYS])
    commanded: Floats = ways[:, windows.last] - ways[:, windows.first]
    return commanded


def _minima(costs: Floats) -> list[tuple[int, int]]:
    """Return the places of the local minima, the lowest first."""
    padded = np.pad(costs, 1, constant_values=np.inf)
    rows, columns = costs.shape
    shifts = [(i, j) for i, j in product(range(3), repeat=2) if (i, j) != (1, 1)]
    neighbours = np.array([padded[i : i + rows, j : j + columns] for i, j in shifts])
    places = np.argwhere(np.all(costs <= neighbours, axis=0))
    return sorted([(int(i), int(j)) for i, j in places], key=lambda place: costs[place])
