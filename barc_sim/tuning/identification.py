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

from barc_sim.errors import UserError, extra
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


_BLIND = 1e-6  #: share of a parameter's direction in which the errors do not change
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


def identify(*logs: Log, vehicle: Vehicle | None = None, integrator: str = 'euler') -> Identified:
    """Return the parameters of the car that made the logs, each with its interval of 95 %.

    Servo, tyres and yaw inertia are among them where the car steered.

    Parameters
    ----------
    logs
        Of one car: of `simulate`, `lap` or `read_bag`. Their inclines count, the errors of
        measurement do not.
    vehicle
        Its mass and lengths; the lab's where it is not given.
    integrator
        'euler', the default of the simulator, or 'rk4' for a real car.

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
    special = extra('scipy.special', 'identify', 'identify')
    stretches = [each for log in logs for each in _stretches(log)]
    if not stretches:
        raise UserError(
            f'none of {len(logs)} logs has {_SHORTEST:g} s of states with commands and no gap: '
            'expected the log of a drive'
        )
    servo = np.concatenate([[c.servo for c in each.commands] for each in stretches])
    seen = all(np.isfinite(each.measured).all() for each in stretches)
    steering = seen and sqrt(np.mean(servo**2)) > _STEERED
    search = _Search(stretches, vehicle or Vehicle(), integrator, 3 if steering else 1)
    names = [*_ALONG, *(_ACROSS if steering else ())]
    lags = [name for name in names if name.endswith('_lag')]
    fit = search.begin({name: _UNKNOWN[name].start for name in names if name not in lags})
    fit = search.fit(fit.values, fit)
    remarks = []
    for lag in lags:
        # A lag far shorter than a step acts as a delay does: it counts where it explains more than
        # any one number explains by chance (Schwarz, Annals of Statistics 6, 1978).
        delay = lag.replace('lag', 'delay')
        shorter = max(fit.values[delay] - _UNKNOWN[lag].start, 0.0)
        with_lag = search.fit(fit.values | {delay: shorter, lag: _UNKNOWN[lag].start}, fit)
        n, cost = fit.errors.size, 0.5 * np.sum((fit.errors / _size(fit.errors)) ** 2)
        if n * np.log(cost / with_lag.cost) > np.log(n):
            fit = with_lag
        else:
            remarks.append(f'{lag} is not seen: there is none, or it counts as delay')
    fit = search.fit(fit.values, fit)
    degrees = fit.errors.size - fit.slopes.shape[1]
    spread = covariance(fit.slopes) * (2.0 * fit.cost / degrees)
    half = special.stdtrit(degrees, 0.975) * np.sqrt(np.diag(spread))
    estimates = {
        name: Estimate(value, float(interval), _UNKNOWN[name].unit, _UNKNOWN[name].meaning)
        for (name, value), interval in zip(fit.values.items(), half, strict=False)
    }
    t = np.concatenate([each.t[each.first :] for each in stretches])
    measured = np.concatenate([each.measured[:, each.first :] for each in stretches], 1)
    found = [*zip(_SIGNALS, measured, fit.errors, strict=False)]
    signals = {signal: (t, values, values + errors) for signal, values, errors in found}
    whiteness = {signal: _whiteness(errors, special) for signal, _, errors in found}
    remarks += [*_unidentified(estimates, spread), *_correlated(whiteness)]
    return Identified(estimates, signals, whiteness, tuple(remarks))


class _Fit(NamedTuple):
    values: dict[str, float]
    speeds: Floats  #: [m/s] at the start of each stretch in motion
    cost: float  #: half of the sum of the squares of the weighted errors
    errors: Floats  #: predicted minus measured: a row for each signal
    slopes: Floats  #: of the weighted errors over the values and speeds


class _Search:
    """Fits what the plant predicts to the first `rows` signals of the stretches."""

    def __init__(
        self, stretches: Sequence[_Stretch], vehicle: Vehicle, integrator: str, rows: int
    ) -> None:
        self._stretches, self._car, self._rows = stretches, (vehicle, integrator), rows

    def begin(self, values: dict[str, float]) -> _Fit:
        """Return a first fit of the parameters with these values, and the best of a few delays."""
        speeds = np.array([each.measured[0, 0] for each in self._stretches if each.in_motion])

        def change(values: Mapping[str, float]) -> float:
            """Return how much the errors change: unknown resistance has little part in it."""
            errors = self._errors(values, speeds)
            return float(np.sum((errors[:, _CHANGE:] - errors[:, :-_CHANGE]) ** 2))

        for name in [name for name in values if name.endswith('_delay')]:
            values = min((values | {name: delay} for delay in _DELAYS), key=change)
        return self.fit(values, _Fit({}, speeds, 0.0, np.ones((self._rows, 1)), speeds))

    def fit(self, start: Mapping[str, float], before: _Fit) -> _Fit:
        """Fit the parameters that `start` has, and the first speed of each stretch in motion.

        Each signal is weighted by the errors of the fit `before`.
        """
        names, weights, free = [*start], 1.0 / _size(before.errors), len(before.speeds)
        steps = np.array([*(_UNKNOWN[name].step for name in names), *[1e-5] * free])
        low = np.array([*(_UNKNOWN[name].lowest for name in names), *[-np.inf] * free])

        def errors(p: Floats) -> Floats:
            values = dict(zip(names, p.tolist(), strict=False))
            return (self._errors(values, p[len(names) :]) * weights).ravel()

        def slopes(p: Floats) -> Floats:
            here = errors(p)
            moved = [errors(p + step) - here for step in np.diag(steps)]
            return np.stack(moved, 1) / steps  # type: ignore[no-any-return]

        found = extra('scipy.optimize', 'identify', 'identify').least_squares(
            errors,
            np.array([*start.values(), *before.speeds]),
            slopes,
            (low, np.inf),
            x_scale='jac',
            max_nfev=_STEPS,
        )
        values = dict(zip(names, found.x.tolist(), strict=False))
        speeds = found.x[len(names) :]
        return _Fit(values, speeds, float(found.cost), self._errors(values, speeds), found.jac)

    def _errors(self, values: Mapping[str, float], speeds: Floats) -> Floats:
        left, found = iter(speeds.tolist()), []
        for each in self._stretches:
            v = next(left) if each.in_motion else 0.0
            errors = each.predict(v, values, *self._car) - each.measured
            found.append(errors[: self._rows, each.first :])
        every: Floats = np.nan_to_num(np.concatenate(found, 1), nan=_WORST)
        return np.clip(every, -_WORST, _WORST)


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


def covariance(slopes: Floats) -> Floats:
    """Return (JᵀJ)⁻¹; infinite on the diagonal for what has no influence of its own."""
    scale = np.linalg.norm(slopes, axis=0)
    scale[scale == 0.0] = 1.0
    inverse = np.linalg.pinv(slopes / scale, 1e-9)
    found: Floats = inverse @ inverse.T / np.outer(scale, scale)
    blind = np.diag(inverse @ slopes) < (1.0 - _BLIND) * scale
    found[blind, blind] = np.inf
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
        if not interval < np.inf:
            yield f'{name} cannot be identified: nothing that was measured depends on it alone'
            continue
        if name.endswith('_delay') or interval < 0.5 * abs(value):
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
