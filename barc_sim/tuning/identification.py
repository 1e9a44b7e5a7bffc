"""Identification: a car's parameters from logs, by least squares on the plant's own prediction.

The plant drives with the recorded commands over the recorded inclines, and its prediction from the
first state on is fitted to the measurement: the output-error method (Ljung, "System
Identification", 2nd ed., section 4.2), which has no bias if the noise is measurement noise. The
speed gives resistance and motor; if the car steered, yaw rate and lateral speed give servo, tyres
and yaw inertia. The 95 % confidence intervals come from the Jacobian at the minimum.

The mass cannot be identified: the motor command is an acceleration. So drag and friction are per
unit mass, and stiffnesses and inertia are for the mass of `vehicle`.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from math import inf, nan, sqrt
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
_SHORTEST = 2.0  #: [s] of a part of a log without a gap
_JUMP = 5.0  #: [m] from one state to the next: more is a return to the start
_STEPS = 30  #: of a search, which usually converges in fewer
_WORST = 1e6  #: error of a car for which the integrator is unstable
_NO_NOISE = 1e-6  #: smaller errors come from rounding
_LAGS = 20  #: of the autocorrelation
_FASTER = 0.01  #: [m/s] of the differences by which the first speed is found
_CHANGE = 10  #: steps over which errors change
#: [s] at which the search may begin.
_DELAYS = 0.0, 0.04, 0.08, 0.12, 0.16, 0.2, 0.26, 0.34, 0.44, 0.6, 0.8
_BLIND = 1e-6  #: share of a parameter's direction in which the errors do not change
_SIGNALS = ('v_x', 'psi_dot', 'v_y')


class _Unknown(NamedTuple):
    """A parameter that is fitted."""

    start: float
    step: float  #: of the differences by which the Jacobian is made
    unit: str
    meaning: str
    lowest: float = -inf


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
_TYRES = LateralParameters._fields


class Estimate(NamedTuple):
    """An estimated parameter: `value` ± `interval` is its 95 % confidence interval."""

    value: float
    interval: float  #: half of the interval's width; infinite if the logs do not show it
    unit: str
    meaning: str

    def __str__(self) -> str:
        """Return value and interval, to its two leading digits; a dash if it is not known."""
        if self.interval == inf:
            return '-'
        if self.interval <= max(1e-6 * abs(self.value), 1e-9):
            return f'{self.value:.6g} ± {self.interval:.2g} {self.unit}'
        digits = max(1 - int(np.floor(np.log10(self.interval))), 0)
        value = round(self.value, digits) + 0.0  # never -0
        return f'{value:.{digits}f} ± {self.interval:.{digits}f} {self.unit}'


@dataclass(frozen=True)
class Identified:
    """The result of `identify`: the parameters by name, as in ``found['motor_delay'].value``."""

    estimates: Mapping[str, Estimate]
    #: By signal: times [s], measured and predicted values, one stretch after the other.
    signals: Mapping[str, tuple[Floats, Floats, Floats]]
    #: By signal, the p-value of a test of the residuals for white noise; NaN: no noise.
    whiteness: Mapping[str, float]
    remarks: tuple[str, ...]  #: sentences on what cannot be identified

    def __getitem__(self, name: str) -> Estimate:
        """Return the estimate of this name."""
        return self.estimates[name]


class _Stretch(NamedTuple):
    """A part of a log without a gap."""

    ts: float  #: [s] from state to state
    t: Floats
    commands: list[Command]
    sines: list[float]  #: of the inclines
    measured: Floats  #: speed, yaw rate and lateral speed: a row each

    @property
    def in_motion(self) -> bool:
        """Whether it begins in motion."""
        return bool(abs(self.measured[0, 0]) > _AT_REST)

    @property
    def first(self) -> int:
        """The first state that counts."""
        return round(_WARM_UP / self.ts) if self.in_motion else 0


def identify(*logs: Log, vehicle: Vehicle | None = None, integrator: str = 'euler') -> Identified:
    """Return the parameters of the car that made the logs, with 95 % confidence intervals.

    The servo is among them where the car steered, tyres and yaw inertia where it slipped.

    Parameters
    ----------
    logs
        Logs of one car, from `simulate`, `lap` or `read_bag`. Their measured values and inclines
        are used; the measurement errors are not.
    vehicle
        Its mass and lengths; by default the lab's.
    integrator
        'euler', the default of the simulator, or 'rk4' for a real car.

    Raises
    ------
    UserError
        if no log has two seconds of states with commands, or SciPy is not installed.

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
    sizes = np.ones((3 if steering else 1, 1))
    search = _Search(stretches, vehicle or Vehicle(), integrator, sizes)
    names = [*_ALONG, *(_ACROSS if steering else ())]
    lags = [name for name in names if name.endswith('_lag')]
    start = search.begin({name: _UNKNOWN[name].start for name in names if name not in lags})
    fit, remarks = search.fit(start), []
    # More parameters count where they explain more than as many numbers explain by chance (Schwarz,
    # Annals of Statistics 6, 1978). Those of a car that does not slip cannot be found.
    n, rest = fit.errors.size, {name: start[name] for name in start if name not in _TYRES}
    if steering and (without := search.fit(rest)).cost < fit.cost * n ** (3.0 / n):
        fit = without
        remarks.append('tyres and yaw inertia are not seen: the car does not slip')
    search = search._replace(sizes=_size(fit.errors))
    fit = search.fit(fit.values)
    for lag in lags:
        # A lag far shorter than a step acts as a delay does.
        delay = lag.replace('lag', 'delay')
        shorter = max(fit.values[delay] - _UNKNOWN[lag].start, 0.0)
        with_lag = search.fit(fit.values | {delay: shorter, lag: _UNKNOWN[lag].start})
        if fit.cost > with_lag.cost * n ** (1.0 / n):
            fit = with_lag
        else:
            remarks.append(f'{lag} is not seen: there is none, or it counts as delay')
    fit = search._replace(sizes=_size(fit.errors)).fit(fit.values)
    # The first speeds are found, too.
    degrees = fit.errors.size - len(fit.values) - sum(each.in_motion for each in stretches)
    # Of a car at rest the cost is 0: what is not known stays infinite.
    spread = covariance(fit.slopes) * max(2.0 * fit.cost / degrees, 1e-300)
    half = special.stdtrit(degrees, 0.975) * np.sqrt(np.diag(spread))
    estimates = {
        name: Estimate(value, float(interval), *_UNKNOWN[name][2:4])
        for (name, value), interval in zip(fit.values.items(), half, strict=True)
    }
    t = np.concatenate([each.t[each.first :] for each in stretches])
    measured = np.concatenate([each.measured[:, each.first :] for each in stretches], 1)
    fitted = [*zip(_SIGNALS, measured, fit.errors, strict=False)]
    signals = {signal: (t, values, values + errors) for signal, values, errors in fitted}
    whiteness = {signal: _whiteness(errors, special) for signal, _, errors in fitted}
    remarks += _remarks(estimates, whiteness)
    return Identified(estimates, signals, whiteness, tuple(remarks))


class _Fit(NamedTuple):
    values: dict[str, float]
    cost: float  #: half of the sum of the squares of the weighted errors
    errors: Floats  #: predicted minus measured: a row for each signal
    slopes: Floats  #: of the weighted errors over the values


class _Search(NamedTuple):
    """Fits the plant's prediction to the first signals of the stretches."""

    stretches: Sequence[_Stretch]
    vehicle: Vehicle
    integrator: str
    sizes: Floats  #: of the errors of each signal, by which it counts

    def begin(self, values: dict[str, float]) -> dict[str, float]:
        """Return values with the best of a few delays."""

        def change(values: Mapping[str, float]) -> float:
            """Return how much the errors change: unknown resistance has little effect on this."""
            errors = self._errors(values)
            return float(np.sum((errors[:, _CHANGE:] - errors[:, :-_CHANGE]) ** 2))

        for name in [name for name in values if name.endswith('_delay')]:
            values = min((values | {name: delay} for delay in _DELAYS), key=change)
        return values

    def fit(self, start: Mapping[str, float]) -> _Fit:
        """Fit the parameters that `start` has."""
        steps, low = np.array([(_UNKNOWN[name].step, _UNKNOWN[name].lowest) for name in start]).T

        def errors(p: Floats) -> Floats:
            return self._errors(dict(zip(start, p.tolist(), strict=True))).ravel()

        optimize = extra('scipy.optimize', 'identify', 'identify')
        slopes = partial(optimize.approx_fprime, f=errors, epsilon=steps)
        result = optimize.least_squares(
            errors, [*start.values()], slopes, (low, inf), x_scale='jac', max_nfev=_STEPS
        )
        values = dict(zip(start, result.x.tolist(), strict=True))
        every = result.fun.reshape(len(self.sizes), -1) * self.sizes
        return _Fit(values, result.cost, every, result.jac)

    @np.errstate(invalid='ignore')  # of a car that the integrator cannot follow
    def _errors(self, values: Mapping[str, float]) -> Floats:
        """Return predicted minus measured, divided by `sizes`: a row for each signal.

        They are linear in the first speed of a stretch, which is chosen to minimise them.
        """
        every = []
        for each in self.stretches:
            counted = np.s_[: len(self.sizes), each.first :]
            v = float(each.measured[0, 0]) if each.in_motion else 0.0
            predicted = self._predict(each, values, v)
            errors = (predicted - each.measured)[counted] / self.sizes
            if each.in_motion:
                faster = self._predict(each, values, v + _FASTER)
                slope = (faster - predicted)[counted] / self.sizes
                errors -= slope * (np.vdot(slope, errors) / (np.vdot(slope, slope) or 1.0))
            every.append(errors)
        return np.clip(np.nan_to_num(np.concatenate(every, 1), nan=_WORST), -_WORST, _WORST)

    def _predict(self, stretch: _Stretch, values: Mapping[str, float], v: float) -> Floats:
        """Return speed, yaw rate and lateral speed of a car that begins with `v` [m/s].

        They are infinite if the integrator is unstable. The recorded incline of each state is a
        force on the car.
        """
        predicted = np.full_like(stretch.measured, inf)
        ts, mass, weight = stretch.ts, self.vehicle.mass, self.vehicle.mass * self.vehicle.gravity
        force = [-weight * sine for sine in stretch.sines]
        lateral = {name: values[name] for name in _TYRES if name in values}
        with suppress(UserError, OverflowError, ValueError):
            plant = Plant(
                road=Road.flat(),
                # `_replace` refuses nothing: on the way a resistance may be below zero.
                vehicle=self.vehicle._replace(
                    air_drag_coeff=values['drag_per_mass'] * mass,
                    friction=values['friction_per_mass'] * mass,
                ),
                ts=ts,
                disturbance=(lambda t, _: force[round(t / ts)]) if any(force) else None,
                motor=Actuator(values['motor_delay'], values.get('motor_lag', 0.0)),
                servo=Actuator(values.get('servo_delay', 0.0), values.get('servo_lag', 0.0)),
                integrator=self.integrator,
                dynamics='dynamic' if lateral else 'kinematic',
                lateral=LateralParameters(**lateral) if lateral else None,
            )
            plant.place(State(v=v))
            if stretch.in_motion:
                plant.actuators.motor.hold(stretch.commands[0].motor)
                plant.actuators.servo.hold(stretch.commands[0].servo)
            for k, command in enumerate(stretch.commands):
                motion = plant.motion()
                predicted[:, k] = motion.v_x, motion.psi_dot, motion.v_y
                plant.advance(command)
        return predicted


def _size(errors: Floats) -> Floats:
    """Return the root mean square of each row, shape `(n, 1)`."""
    size: Floats = np.maximum(np.sqrt(np.mean(errors**2, 1, keepdims=True)), _NO_NOISE)
    return size


def _stretches(log: Log) -> Iterator[_Stretch]:
    """Yield the parts of a log that have commands and no gap or reset, and are long enough."""
    measured = np.flatnonzero(np.isfinite(log.v_x))
    if len(measured) < 2 or not np.isfinite(log.motor).any():  # noqa: PLR2004
        return
    steps = np.diff(log.t[measured])
    ts = float(np.median(steps))
    jumps = abs(np.diff(log.distance[measured])) > _JUMP
    for part in np.split(measured, np.flatnonzero((abs(steps - ts) > 0.1 * ts) | jumps) + 1):
        if len(part) * ts >= _SHORTEST:
            rows = slice(part[0], part[-1] + 1)
            # Where a command missed its deadline, the one before it held.
            acted = (np.where(log.missed, nan, column) for column in (log.motor, log.servo))
            # The plant is slower on NumPy's numbers, which warn of what overflows, too.
            commands = (_held(column[rows]).tolist() for column in acted)
            yield _Stretch(
                round(ts * 1e9) / 1e9,
                log.t[rows],
                [*map(Command, *commands)],
                np.sin(np.radians(np.nan_to_num(log.theta_deg[rows]))).tolist(),
                np.array([log.v_x[rows], log.psi_dot[rows], log.v_y[rows]]),
            )


def _held(values: Floats) -> Floats:
    """Return the commands, with the one before in place of each missing one, zero at first."""
    at = np.where(np.isfinite(values), np.arange(len(values)), -1)
    held: Floats = np.append(values, 0.0)[np.maximum.accumulate(at)]
    return held


def covariance(slopes: Floats) -> Floats:
    """Return (JᵀJ)⁻¹; infinite on the diagonal for parameters without an effect of their own."""
    scale = np.linalg.norm(slopes, axis=0)
    scale[scale == 0.0] = 1.0
    inverse = np.linalg.pinv(slopes / scale, 1e-9)
    inverted: Floats = inverse @ inverse.T / np.outer(scale, scale)
    blind = np.diag(inverse @ slopes) < (1.0 - _BLIND) * scale
    inverted[blind, blind] = inf
    return inverted


def _whiteness(errors: Floats, special: Any) -> float:  # noqa: ANN401 (a module)
    """Return the p-value of the test of Ljung and Box (Biometrika 65, 1978)."""
    n, energy = len(errors), errors @ errors
    if energy < n * _NO_NOISE**2:
        return nan
    lags = np.arange(1, _LAGS + 1)
    correlations = np.array([errors[lag:] @ errors[:-lag] for lag in lags]) / energy
    statistic = n * (n + 2) * np.sum(correlations**2 / (n - lags))
    return float(special.gammaincc(_LAGS / 2.0, statistic / 2.0))


def _remarks(estimates: Mapping[str, Estimate], whiteness: Mapping[str, float]) -> Iterator[str]:
    """Yield a sentence for each parameter, and each signal, that the logs do not show well."""
    for name, (value, interval, unit, _) in estimates.items():
        if interval == inf:
            yield f'{name} cannot be identified: no measured signal depends on it alone'
        elif not name.endswith('_delay') and interval >= 0.5 * abs(value):
            yield f'{name} cannot be identified: it is known to ±{interval:.2g} {unit} only'
    for signal, p in whiteness.items():
        if p < 0.01:  # noqa: PLR2004
            yield (
                f'the residuals of {signal} are not white noise (p = {p:.2g}): the car does more '
                'than the model, and the intervals are too narrow'
            )
