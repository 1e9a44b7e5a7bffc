"""Identification: a car's parameters from logs, by least squares on the plant's own prediction.

The plant drives with the recorded commands over the recorded inclines, and what it predicts from
the first state on is fitted to what was measured: the output-error method (Ljung, "System
Identification", 2nd ed., section 4.2), which has no bias where the noise is that of measurement.
The speed gives resistance and motor; where the car steered, yaw rate and lateral speed give
servo, tyres and yaw inertia. Intervals are of 95 %, from the Jacobian at the minimum.

The mass alone is in no log: the motor is commanded an acceleration, so that drag and friction
count by mass, and stiffnesses and inertia are those that go with the mass of `vehicle`.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import nan, radians, sqrt
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from barc_sim.errors import UserError
from barc_sim.vehicle.bicycles import LateralParameters
from barc_sim.vehicle.bike_model import Command, State, Vehicle
from barc_sim.vehicle.plant import Actuator, Plant
from barc_sim.vehicle.road import Road

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from barc_sim.simulation.log import Floats, Log

_STEERED = 0.01  #: [rad] rms of the commands of a car that steered
_AT_REST = 0.25  #: [m/s]
_WARM_UP = 1.0  #: [s] of a car in motion, whose earlier commands are unknown
_SHORTEST = 2.0  #: [s] of a stretch without a gap
_JUMP = 5.0  #: [m] from one state to the next: more is a return to the start
_EDGE = 0.02  #: share of a step
_STEPS = 30  #: of a search: what the logs show is found in fewer
_WORST = 1e6  #: error of a car that no step can follow
_NO_NOISE = 1e-6  #: errors below are those of rounding
_LAGS = 20  #: of the autocorrelation
_CHANGE = 10  #: steps over which errors change
#: [s] at which the search may begin.
_DELAYS = 0.0, 0.04, 0.08, 0.12, 0.16, 0.2, 0.26, 0.34, 0.44, 0.6, 0.8


class _Unknown(NamedTuple):
    """A parameter that is fitted."""

    start: float
    step: float  #: of the differences by which the Jacobian is made
    unit: str
    meaning: str
    lowest: float = -np.inf


_SHARE = 1e-3  #: of a direction in which the errors do not change
_TOGETHER = 0.9  #: correlation of two parameters that are hard to separate
_SIGNALS = ('v_x', 'psi_dot', 'v_y')
_ALONG = {
    'drag_per_mass': _Unknown(0.0, 1e-6, '1/m', 'air_drag_coeff / mass'),
    'friction_per_mass': _Unknown(0.0, 1e-5, 'm/s²', 'friction / mass'),
    'motor_delay': _Unknown(0.1, 1e-4, 's', 'time from a command to its effect', 0.0),
    'motor_lag': _Unknown(0.05, 1e-4, 's', 'time constant of the motor', 0.0),
}
_ACROSS = {
    'servo_delay': _Unknown(0.1, 1e-4, 's', 'time from a command to its effect', 0.0),
    'servo_lag': _Unknown(0.05, 1e-4, 's', 'time constant of the servo', 0.0),
    'front_stiffness': _Unknown(120e3, 10.0, 'N/rad', "of the front axle's tyres", 1e3),
    'rear_stiffness': _Unknown(160e3, 10.0, 'N/rad', "of the rear axle's tyres", 1e3),
    'yaw_inertia': _Unknown(4000.0, 1.0, 'kg m²', 'about the vertical axis', 1e2),
}


_UNKNOWN = _ALONG | _ACROSS


class Estimate(NamedTuple):
    """A parameter that was found: the true one is within `value` ± `interval` in 95 of 100."""

    value: float
    interval: float  #: half of the interval's width; infinite where the log says nothing
    unit: str
    meaning: str

    def __str__(self) -> str:
        """Return value and interval with its two leading digits; six of the value at most."""
        if not max(1e-6 * abs(self.value), 1e-9) < self.interval < np.inf:
            return f'{self.value:.6g} ± {self.interval:.2g} {self.unit}'
        digits = max(1 - int(np.floor(np.log10(self.interval))), 0)
        value = round(self.value, digits) + 0.0  # never -0
        return f'{value:.{digits}f} ± {self.interval:.{digits}f} {self.unit}'


@dataclass(frozen=True)
class Identified:
    """What `identify` found: the parameters by name, as in ``found['motor_delay'].value``."""

    estimates: Mapping[str, Estimate]
    #: By signal: times [s], measured and predicted values, one stretch after the other.
    signals: Mapping[str, tuple[Floats, Floats, Floats]]
    #: By signal, how likely residuals of white noise are as correlated as these; NaN: no noise.
    whiteness: Mapping[str, float]
    remarks: tuple[str, ...]  #: what the logs do not show

    def __getitem__(self, name: str) -> Estimate:
        """Return the estimate of this name."""
        return self.estimates[name]


class _Stretch:
    """A part of a log without a gap."""

    def __init__(self, log: Log, rows: slice, ts: float) -> None:
        self.ts = ts
        self.t = log.t[rows]
        # The plant is slower on NumPy's numbers, which warn of what overflows, too.
        self.theta = np.nan_to_num(log.theta_deg[rows]).tolist()
        commands = (_held(column[rows]) for column in (log.motor, log.servo))
        self.commands = [*map(Command, *commands)]
        self.measured = np.array([log.v_x[rows], log.psi_dot[rows], log.v_y[rows]])
        self.in_motion = abs(self.measured[0, 0]) > _AT_REST
        self.first = round(_WARM_UP / ts) if self.in_motion else 0

    def predict(
        self, v: float, values: Mapping[str, float], vehicle: Vehicle, integrator: str
    ) -> Floats:
        """Return speed, yaw rate and lateral speed of a car that begins with `v` [m/s].

        They are infinite where the integrator cannot follow it.
        """
        try:
            plant = _plant(self.ts, values, vehicle, integrator)
            plant.place(State(v=v))
            return self._drive(plant)
        except (UserError, OverflowError, ValueError):
            return np.full_like(self.measured, np.inf)

    def _drive(self, plant: _PlantOnRecord) -> Floats:
        if self.in_motion:
            plant.actuators.motor.hold(self.commands[0].motor)
            plant.actuators.servo.hold(self.commands[0].servo)
        found = np.empty((3, len(self.commands)))
        for k, command in enumerate(self.commands):
            motion = plant.motion()
            found[:, k] = motion.v_x, motion.psi_dot, motion.v_y
            plant.incline = self.theta[k]
            plant.advance(command)
        return found


def identify(
    *logs: Log,
    vehicle: Vehicle | None = None,
    integrator: str = 'euler',
    steering: bool | None = None,
) -> Identified:
    """Return the parameters of the car that made the logs, each with its interval of 95 %.

    Parameters
    ----------
    logs
        Of one car: of `simulate`, `lap` or `read_bag`. Their inclines count, the errors of
        measurement do not.
    vehicle
        Its mass and lengths; the lab's where it is not given.
    integrator
        'euler', the default of the simulator, or 'rk4' for a real car.
    steering
        Whether to fit servo, tyres and yaw inertia, too; where the car steered, unless given.

    Raises
    ------
    UserError
        where no log has two seconds of states with commands, or SciPy is not installed.

    Examples
    --------
    >>> from barc_sim import Vehicle, simulate
    >>> from barc_sim.control.excitation import PRBS
    >>> car = Vehicle(friction=300.0, air_drag_coeff=0.8)
    >>> log = simulate(
    ...     controller=PRBS(), vehicle=car, road='flat', noise=0.02, delay=0.13, distance=40.0
    ... )
    >>> print(identify(log)['motor_delay'])
    0.13015 ± 0.00086 s
    """
    optimize, special = _scipy()
    stretches = [each for log in logs for each in _stretches(log)]
    if not stretches:
        raise UserError(
            f'none of {len(logs)} logs has {_SHORTEST:g} s of states with commands and no gap: '
            'expected the log of a drive'
        )
    if steering is None:
        servo = np.concatenate([[c.servo for c in each.commands] for each in stretches])
        seen = all(np.isfinite(each.measured).all() for each in stretches)
        steering = seen and sqrt(np.mean(servo**2)) > _STEERED
    car = vehicle or Vehicle(), integrator
    names = [*_ALONG, *(_ACROSS if steering else ())]
    lags = [name for name in names if name.endswith('_lag')]
    start = {name: _UNKNOWN[name].start for name in names if name not in lags}
    fit = _fit(stretches, start, car, optimize)
    fit = _fit(stretches, fit.values, car, optimize, fit)
    remarks = []
    for lag in lags:
        # A lag far shorter than a step acts as a delay does: it counts where it explains more than
        # any one number explains by chance (Schwarz, Annals of Statistics 6, 1978).
        delay = lag.replace('lag', 'delay')
        shorter = max(fit.values[delay] - _UNKNOWN[lag].start, 0.0)
        with_lag = _fit(
            stretches, fit.values | {delay: shorter, lag: _UNKNOWN[lag].start}, car, optimize, fit
        )
        n, cost = fit.errors.size, 0.5 * np.sum((fit.errors / _size(fit.errors)) ** 2)
        if n * np.log(cost / with_lag.cost) > np.log(n):
            fit = with_lag
        else:
            remarks.append(f'{lag} is not seen: there is none, or it counts as delay')
    fit = _fit(stretches, fit.values, car, optimize, fit)
    degrees = fit.errors.size - fit.slopes.shape[1]
    spread = _inverse(fit.slopes) * (2.0 * fit.cost / degrees)
    half = special.stdtrit(degrees, 0.975) * np.sqrt(np.diag(spread))
    estimates = {
        name: Estimate(value, float(interval), _UNKNOWN[name].unit, _UNKNOWN[name].meaning)
        for (name, value), interval in zip(fit.values.items(), half, strict=False)
    }
    t = np.concatenate([each.t[each.first :] for each in stretches])
    measured = np.concatenate([each.measured[:, each.first :] for each in stretches], 1)
    signals = {
        signal: (t, values, values + errors)
        for signal, values, errors in zip(_SIGNALS, measured, fit.errors, strict=False)
    }
    whiteness = {
        signal: _whiteness(errors, special)
        for signal, errors in zip(_SIGNALS, fit.errors, strict=False)
    }
    remarks += [*_unidentified(estimates, spread), *_correlated(whiteness)]
    return Identified(estimates, signals, whiteness, tuple(remarks))


class _Fit(NamedTuple):
    values: dict[str, float]
    speeds: Floats  #: [m/s] at the start of each stretch in motion
    cost: float  #: half of the sum of the squares of the weighted errors
    errors: Floats  #: predicted minus measured: a row for each signal
    slopes: Floats  #: of the weighted errors over the values and speeds


def _fit(
    stretches: Sequence[_Stretch],
    start: Mapping[str, float],
    car: tuple[Vehicle, str],
    optimize: Any,  # noqa: ANN401 (a module)
    before: _Fit | None = None,
) -> _Fit:
    """Fit the parameters that `start` names, and the first speed of each stretch in motion.

    Each signal is weighted by the errors of the fit `before`; without one, the first delays are the
    best of a few.
    """
    names, n = [*start], sum(each.in_motion for each in stretches)
    steps = np.array([*(_UNKNOWN[name].step for name in names), *[1e-5] * n])
    low = np.array([*(_UNKNOWN[name].lowest for name in names), *[-np.inf] * n])
    high = np.full(len(low), np.inf)
    rows = 3 if 'yaw_inertia' in start else 1
    weights = 1.0 / _size(before.errors) if before else np.ones((rows, 1))
    owner = np.concatenate([np.full(len(s.commands) - s.first, i) for i, s in enumerate(stretches)])
    owns = [np.tile(owner == i, rows) for i, s in enumerate(stretches) if s.in_motion]

    def errors(p: Floats) -> Floats:
        every = p.tolist()
        values, speeds = dict(zip(names, every, strict=False)), iter(every[len(names) :])
        parts = [
            (each.predict(next(speeds) if each.in_motion else 0.0, values, *car) - each.measured)
            for each in stretches
        ]
        kept = [part[:rows, each.first :] for part, each in zip(parts, stretches, strict=True)]
        found: Floats = np.nan_to_num(np.concatenate(kept, 1), nan=_WORST)
        return np.clip(found, -_WORST, _WORST)

    def weighted(p: Floats) -> Floats:
        return (errors(p) * weights).ravel()

    def slopes(p: Floats) -> Floats:
        at, shifts = weighted(p), np.where(p + steps > high, -steps, steps)
        # A first speed moves the errors of its own stretch alone: all are moved at once.
        m = len(names)
        together = [np.where(np.arange(len(p)) < m, 0.0, shifts)] if n else []
        moved = [weighted(p + row) - at for row in (*np.diag(shifts)[:m], *together)]
        moved = [*moved[:m], *(np.where(own, moved[-1], 0.0) for own in owns)]
        return np.stack(moved, 1) / shifts

    def change(p: Floats) -> float:
        """Return how much the errors change: unknown resistance has little part in it."""
        at = errors(p)
        return float(np.sum((at[:, _CHANGE:] - at[:, :-_CHANGE]) ** 2))

    measured = [each.measured[0, 0] for each in stretches if each.in_motion]
    first = before.speeds if before else measured
    p = np.array([*start.values(), *first])
    delays = [i for i, name in enumerate(names) if name.endswith('_delay')]
    for i in () if before else delays:
        p = min((np.where(np.arange(len(p)) == i, delay, p) for delay in _DELAYS), key=change)
    # Over a delay the prediction has a bend at each whole step, where a search would stick: it goes
    # on in the next step as long as that is better.
    ts = max(each.ts for each in stretches)
    whole = {i: int(p[i] / ts + 1e-6) for i in delays}
    cost, moves = np.inf, whole
    while moves:
        for i, k in (whole | moves).items():
            low[i], high[i] = k * ts, (k + 1) * ts
        # Not from a bend: there the search would hardly move.
        begin = p.copy()
        for i in delays:
            begin[i] = p[i] if low[i] < p[i] < high[i] else (whole | moves)[i] * ts + 0.5 * ts
        found = optimize.least_squares(
            weighted, begin, slopes, (low, high), x_scale='jac', max_nfev=_STEPS
        )
        if not found.cost < cost * (1.0 - 1e-9):
            break
        p, cost, jacobian, whole = found.x, float(found.cost), found.jac, whole | moves
        beyond = {i: round((p[i] / ts - whole[i] - 0.5) / (1.0 - _EDGE)) for i in delays}
        moves = {i: whole[i] + way for i, way in beyond.items() if way and whole[i] + way >= 0}
    values = dict(zip(names, p.tolist(), strict=False))
    return _Fit(values, p[len(names) :], cost, errors(p), jacobian)


def _size(errors: Floats) -> Floats:
    """Return the root mean square of each row, shape `(n, 1)`."""
    size: Floats = np.maximum(np.sqrt(np.mean(errors**2, 1, keepdims=True)), _NO_NOISE)
    return size


def _stretches(log: Log) -> list[_Stretch]:
    """Return the parts of a log with neither gap nor reset that are commanded and long enough."""
    known = np.flatnonzero(np.isfinite(log.v_x))
    if len(known) < 2 or not np.isfinite(log.motor).any():  # noqa: PLR2004
        return []
    steps = np.diff(log.t[known])
    ts = float(np.median(steps))
    jumps = abs(np.diff(log.distance[known])) > _JUMP
    ends = np.flatnonzero((abs(steps - ts) > 0.1 * ts) | jumps) + 1
    parts = np.split(known, ends)
    ts = round(ts * 1e9) / 1e9
    return [
        _Stretch(log, slice(part[0], part[-1] + 1), ts)
        for part in parts
        if len(part) * ts >= _SHORTEST
    ]


def _held(values: Floats) -> list[float]:
    """Return commands where each that is missing is the one before it, and zero at first."""
    at = np.where(np.isfinite(values), np.arange(len(values)), -1)
    padded = np.append(values, 0.0)
    held: list[float] = padded[np.maximum.accumulate(at)].tolist()
    return held


class _PlantOnRecord(Plant):
    """A plant on the incline that was recorded at each state."""

    incline = 0.0  #: [deg]

    def _grade(self, _: float) -> float:
        return radians(self.incline)


def _plant(
    ts: float, values: Mapping[str, float], vehicle: Vehicle, integrator: str
) -> _PlantOnRecord:
    # `_replace` refuses nothing: on the way to the minimum a resistance may be below zero.
    resisting = vehicle._replace(
        air_drag_coeff=values['drag_per_mass'] * vehicle.mass,
        friction=values['friction_per_mass'] * vehicle.mass,
    )
    lateral = None
    if steering := 'yaw_inertia' in values:
        lateral = LateralParameters(
            values['yaw_inertia'], values['front_stiffness'], values['rear_stiffness']
        )
    return _PlantOnRecord(
        road=Road.flat(),
        vehicle=resisting,
        ts=ts,
        motor=Actuator(values['motor_delay'], values.get('motor_lag', 0.0)),
        servo=Actuator(values['servo_delay'], values.get('servo_lag', 0.0)) if steering else None,
        integrator=integrator,
        dynamics='dynamic' if steering else 'kinematic',
        lateral=lateral,
    )


def _inverse(slopes: Floats) -> Floats:
    """Return (JᵀJ)⁻¹; infinite on the diagonal for what has no influence of its own."""
    scale = np.linalg.norm(slopes, axis=0)
    scale[scale == 0.0] = 1.0
    _, singular, directions = np.linalg.svd(slopes / scale, full_matrices=False)
    seen = singular > 1e-9 * singular[0]
    inverse = (directions[seen].T / singular[seen] ** 2) @ directions[seen]
    blind = (abs(directions[~seen]) > _SHARE).any(axis=0)
    inverse[blind, blind] = np.inf
    found: Floats = inverse / np.outer(scale, scale)
    return found


def _whiteness(errors: Floats, special: Any) -> float:  # noqa: ANN401 (a module)
    """Return the p-value of the test of Ljung and Box (Biometrika 65, 1978)."""
    n, energy = len(errors), errors @ errors
    if energy < n * _NO_NOISE**2:
        return nan
    lags = np.arange(1, _LAGS + 1)
    correlations = np.array([errors[lag:] @ errors[:-lag] for lag in lags]) / energy
    statistic = n * (n + 2) * np.sum(correlations**2 / (n - lags))
    return float(special.gammaincc(_LAGS / 2.0, statistic / 2.0))


def _unidentified(estimates: Mapping[str, Estimate], covariance: Floats) -> Iterator[str]:
    """Yield a sentence for each parameter that the logs do not show."""
    names, deviations = [*estimates], np.sqrt(np.diag(covariance))
    for i, (name, (value, interval, unit, _)) in enumerate(estimates.items()):
        if name.endswith('_delay') or interval < 0.5 * abs(value):
            continue
        if not interval < np.inf:
            yield f'{name} cannot be identified: nothing that was measured depends on it alone'
            continue
        together = covariance[i] / (deviations[i] * deviations)
        together[i] = 0.0
        other = int(np.argmax(abs(together[: len(names)])))
        cause = ''
        if abs(together[other]) > _TOGETHER:
            cause = f', as {names[other]} has the same effect in this drive'
        yield f'{name} cannot be identified: it is known to ±{interval:.2g} {unit} only{cause}'


def _correlated(whiteness: Mapping[str, float]) -> list[str]:
    return [
        f'the residuals of {signal} are no white noise (p = {p:.2g}): the car does more than the '
        'model, and the intervals are too narrow'
        for signal, p in whiteness.items()
        if p < 0.01  # noqa: PLR2004
    ]


def _scipy() -> tuple[Any, Any]:
    try:
        from scipy import optimize, special  # noqa: PLC0415 (an extra)
    except ImportError:
        raise UserError(
            "identify needs SciPy, which is not installed: pip install 'barc_sim[identify]'"
        ) from None
    return optimize, special
