"""Identification: a car's parameters from logs, by least squares on the plant's own prediction.

`predict` drives the car with the recorded commands over the recorded inclines, and its prediction
is fitted to the measurement: the output-error method (Ljung, "System Identification", 2nd ed.,
section 4.2), which has no bias if the noise is measurement noise. The speed gives resistance and
motor; if the car steered, yaw rate and lateral speed give servo, tyres and yaw inertia.

The error has several minima over delay and lag. So a coarse search over both, by linear regression,
gives several starts, and the best fit counts. A 95 % confidence interval comes from the Jacobian at
the minimum; that of a delay from the profile of the error (Bates and Watts, "Nonlinear Regression
Analysis", section 6.1), because its derivative jumps at each whole step. `bootstrap.py` has other
intervals, which need no linear model, and keep correlation of the noise.

The mass cannot be identified: the motor command is an acceleration. So drag and friction are per
unit mass, and stiffnesses and inertia are for the mass of `vehicle`.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from math import inf, nan, sqrt
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from barc_sim.cli.packages import extra
from barc_sim.errors import UserError
from barc_sim.parallel.pieces import PieceSizes, finished_pieces, result_of, workers_of
from barc_sim.simulation.log import COLUMNS
from barc_sim.tuning import MIN_RESAMPLES
from barc_sim.tuning.bootstrap import half_interval, resampled
from barc_sim.tuning.prediction import (
    AT_REST,
    CarModel,
    free_responses,
    predict,
    stretches,
    with_certain_commands,
    without_negligible,
)
from barc_sim.tuning.starts import gain_of, motor_starts, servo_delay_start
from barc_sim.vehicle.bicycles import LateralParameters
from barc_sim.vehicle.bike_model import Vehicle
from barc_sim.vehicle.law import is_compiled
from barc_sim.vehicle.plant import Actuator

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence
    from concurrent.futures import Executor

    from barc_sim.simulation.log import Floats, Log
    from barc_sim.tuning.prediction import Stretch

_STEERED = 0.01  #: [rad] rms of the commands of a car that steered
_STEPS = 30  #: of a search, which usually converges in fewer
_FIRST_STEPS = 10  #: from each of several starts, and from a better delay
_WORST = 1e6  #: error of a car for which the integrator is unstable
_NO_NOISE = 1e-6  #: smaller errors come from rounding
_LAGS = 20  #: of the autocorrelation
_MANY = 10_000  #: steps of a straight drive, whose predictions take about 2 s in Python
_FASTER = 0.01  #: [m/s] of the differences by which the first speed is found
_BLIND = 1e-6  #: share of a parameter's direction in which the errors do not change
_SIGNALS = ('v_x', 'psi_dot', 'v_y')
_SCANNED = np.arange(-8, 9) / 5.0  #: steps from a delay at which the error can be smaller
_ROUNDS = 3  #: of scans
_BETTER = 1e-6  #: share of the error by which another fit must be better
_WIDENINGS = 40  #: of an interval, until the error is significantly larger
_SIGNIFICANT = 0.01  #: p-value of residuals that are no white noise
_LARGEST = 1e9  #: value in any unit
_GAINS = (0.5, 2.0)  #: Beyond them a unit is wrong.
#: Noise is no sensor's beyond these shares of the speed's standard deviation and of its size.
_OF_SPREAD = 0.5
_OF_SIZE = 0.05


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

    @property
    def is_negative(self) -> bool:
        """Whether all of the interval is below 0."""
        return self.value + self.interval < 0.0

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


def identify(
    *logs: Log,
    vehicle: Vehicle | None = None,
    integrator: str = 'euler',
    bootstrap: int = 0,
    seed: int = 0,
    executor: Executor | None = None,
) -> Identified:
    """Return the parameters of the car that made the logs, with 95 % confidence intervals.

    The servo is among them where the car steered, tyres and yaw inertia where it slipped.

    Parameters
    ----------
    logs
        Logs of one car, from `simulate`, `lap` or `read_bag`. Their measured values and inclines
        are used; the measurement errors are not. Rows may be missing. A row may have a state, a
        command or both: each command acts from its own time on.
    vehicle
        Its mass and lengths; by default the lab's.
    integrator
        'euler', the default of the simulator, or 'rk4' for a real car.
    bootstrap
        Number of resamples of the residuals, each of which is fitted, too: the percentiles of the
        fits are the intervals, in place of those by the Jacobian. They are wider where residuals
        are correlated, but not always wide enough. 0: no bootstrap; 1000 is usual.
    seed
        Of the random numbers of the bootstrap.
    executor
        Fits the resamples: any executor of `concurrent.futures`. By default this process does.

    Raises
    ------
    UserError
        if no log has two seconds of states with commands, if speeds or commands are those of no
        car, if `bootstrap` is too small, or if SciPy is not installed.

    Examples
    --------
    >>> from barc_sim import Vehicle, simulate
    >>> from barc_sim.control.excitation import PRBS
    >>> car = Vehicle(friction=300.0, air_drag_coeff=0.8)
    >>> log = simulate(
    ...     controller=PRBS(), vehicle=car, road='flat', noise=0.02, delay=0.13, distance=40.0
    ... )
    >>> print(identify(log)['motor_delay'])
    0.13014 ± 0.00088 s
    """
    special = extra('scipy.special', 'identify', 'identify')
    if bootstrap and bootstrap < MIN_RESAMPLES:
        raise UserError(
            f'bootstrap={bootstrap} must be at least {MIN_RESAMPLES}, as the intervals are '
            'percentiles; 1000 is usual'
        )
    for log in logs:
        _check_sizes(log)

    parts: list[Stretch] = []
    for log in logs:
        parts.extend(stretches(log))
    if not parts:
        raise UserError(
            f'none of {len(logs)} logs has 2 s of states with commands and no gap: '
            'expected the log of a drive'
        )

    vehicle = vehicle or Vehicle()
    noise = _noise(parts)
    _check_continuous(parts, noise)
    parts = [without_negligible(part, vehicle, noise) for part in parts]

    # The speed gives resistance and motor, and with them the commands that were lost.
    search = _Search(
        stretches=tuple(parts),
        vehicle=vehicle,
        integrator=integrator,
        sizes=np.ones((1, 1)),
        noise=noise,
        is_fast=is_worth_compiling(parts),
    )
    fit, remarks = _fit_along(search)
    search = search.with_certain_commands(fit.values)
    fit = search.fit(fit.values)

    # All signals give servo and tyres, and each counts by the size of its errors.
    if _has_steered(parts):
        search = search._replace(sizes=np.ones((3, 1)))
        fit, remarks_across = _fit_across(search, fit)
        remarks += remarks_across

    search = search._replace(sizes=_size(fit.errors))
    fit = search.across_kinks(search.fit(fit.values))

    estimates = _estimates(search, fit, special)
    if bootstrap:
        fits = _fits_of_resamples(_Resamples.of(search, fit, seed), bootstrap, executor)
        estimates = {
            name: _with_percentiles(estimate, fits[name]) for name, estimate in estimates.items()
        }
    signals: dict[str, tuple[Floats, Floats, Floats]] = {}
    whiteness: dict[str, float] = {}
    t = np.concatenate([part.t[part.counted] for part in parts])
    measured = np.concatenate([part.measured[:, part.counted] for part in parts], 1)
    for signal, values, errors in zip(_SIGNALS, measured, fit.errors, strict=False):
        signals[signal] = (t, values, values + errors)
        whiteness[signal] = _whiteness(errors, special)

    remarks += _remarks(estimates, whiteness, is_linearised=not bootstrap)
    is_odd = any(each.is_negative for each in estimates.values())
    if is_odd or whiteness['v_x'] < _SIGNIFICANT:
        remarks += _remark_on_units(parts, vehicle)
    return Identified(estimates, signals, whiteness, tuple(remarks))


def _estimates(search: _Search, fit: _Fit, special: Any) -> dict[str, Estimate]:  # noqa: ANN401
    """Return the parameters of a fit by name, with their confidence intervals."""
    degrees = search.degrees(fit)
    # Of a car at rest the cost is 0: what is not known stays infinite.
    variance = max(2.0 * fit.cost / degrees, 1e-300)
    quantile = float(special.stdtrit(degrees, 0.975))
    half = quantile * np.sqrt(np.diag(covariance(fit.slopes) * variance))
    by_slope = dict(zip(fit.values, half.tolist(), strict=True))

    estimates = {}
    for name in sorted(fit.values, key=[*_UNKNOWN].index):
        interval = by_slope[name]
        if name.endswith('_delay') and interval < inf:
            interval = search.interval(fit, name, interval, quantile**2 * variance)
        unknown = _UNKNOWN[name]
        estimates[name] = Estimate(fit.values[name], interval, unknown.unit, unknown.meaning)
    return estimates


def is_worth_compiling(parts: Sequence[Stretch]) -> bool:
    """Return whether compiled predictions save more time than Numba needs to start."""
    rows = sum(len(each.t) for each in parts)
    return is_compiled() and (_has_steered(parts) or rows > _MANY)


def _has_steered(parts: Sequence[Stretch]) -> bool:
    """Return whether the car steered, and yaw rate and lateral speed were measured."""
    angles = np.concatenate([each.servo.at(each.t) for each in parts])
    is_seen = all(np.isfinite(each.measured[:, each.counted]).all() for each in parts)
    return is_seen and sqrt(float(np.mean(angles**2))) > _STEERED


def _noise(parts: Sequence[Stretch]) -> float:
    """Return roughly the standard deviation of the speed's noise [m/s], of second differences."""
    bends = np.concatenate([np.diff(each.measured[0, each.counted], 2) for each in parts])
    return float(np.median(np.abs(bends))) / (0.6745 * sqrt(6.0))


def _check_sizes(log: Log) -> None:
    """Refuse values whose squares leave the range of numbers."""
    for name in (*_SIGNALS, 'motor', 'servo'):
        values = np.nan_to_num(getattr(log, name), posinf=0.0, neginf=0.0)
        largest = float(values[np.argmax(np.abs(values))]) if len(values) else 0.0
        if abs(largest) > _LARGEST:
            size = f'{largest:.3g} {COLUMNS[name].unit}'
            raise UserError(
                f'a value of {name} is {size}, as that of no car: expected at most {_LARGEST:g}; '
                'leave out its row'
            )


def _check_continuous(parts: Sequence[Stretch], noise: float) -> None:
    """Refuse speeds that jump from state to state: no parameters explain them."""
    speeds = np.concatenate([each.measured[0, each.counted] for each in parts])
    commands = np.concatenate([each.motor.values for each in parts])
    step = max(float(np.median(np.diff(each.t[each.counted]))) for each in parts)

    # The commands can change the speed so much from one step to the next.
    commanded = 2.0 * float(np.abs(commands).max()) * step
    usual = _OF_SIZE * sqrt(float(np.mean(speeds**2)))

    if noise > max(_OF_SPREAD * float(np.std(speeds)), usual + commanded + AT_REST):
        raise UserError(
            f'the speed v_x jumps by {noise:.2g} m/s from state to state, as that of no car: check '
            'that the states are in the order of their times'
        )


def _fit_along(search: _Search) -> tuple[_Fit, list[str]]:
    """Fit resistance and motor to the speed; return remarks, too."""
    with_lag, without_lag = motor_starts(search.stretches, search.vehicle)

    lagging = search.best([start._asdict() for start in with_lag])
    ideal = search.best([_without(start._asdict(), 'motor_lag') for start in without_lag])
    if _explains_more(lagging, ideal):
        return lagging, []
    return ideal, ['motor_lag is not seen: there is none, or it counts as delay']


def _without(values: Mapping[str, float], name: str) -> dict[str, float]:
    """Return the values but for the one of this name."""
    return {other: value for other, value in values.items() if other != name}


def _fit_across(search: _Search, along: _Fit) -> tuple[_Fit, list[str]]:
    """Fit servo and tyres, too, to all signals; return remarks, too."""
    remarks = []
    delay = servo_delay_start(search.stretches, search.vehicle)
    start = along.values | {'servo_delay': delay}
    tyres = {name: _UNKNOWN[name].start for name in _ACROSS if name in _TYRES}
    fit = search.fit(start | tyres)

    # Those of a car that does not slip cannot be found.
    without = search.fit(start)
    if not _explains_more(fit, without, len(tyres)):
        fit = without
        remarks.append('tyres and yaw inertia are not seen: the car does not slip')
    search = search._replace(sizes=_size(fit.errors))
    fit = search.fit(fit.values)

    # A lag far shorter than a step acts as a delay does.
    lag = _UNKNOWN['servo_lag'].start
    shorter = max(fit.values['servo_delay'] - lag, 0.0)
    lagging = search.fit(fit.values | {'servo_delay': shorter, 'servo_lag': lag})
    if _explains_more(lagging, fit):
        return lagging, remarks
    remarks.append('servo_lag is not seen: there is none, or it counts as delay')
    return fit, remarks


def _explains_more(fit: _Fit, without: _Fit, additional: int = 1) -> bool:
    """Return whether a fit with more parameters explains more than as many explain by chance.

    (Schwarz, Annals of Statistics 6, 1978.)
    """
    n = fit.errors.size
    chance: float = n ** (additional / n)
    return without.cost > fit.cost * chance


class _Point(NamedTuple):
    """Values of the parameters, and half of the sum of the squares of the weighted errors."""

    values: dict[str, float]
    cost: float


class _Solved(NamedTuple):
    """The errors of a stretch, and what was estimated besides the parameters."""

    errors: Floats  #: predicted minus measured, divided by their sizes: a row for each signal
    prior: Floats  #: of what was lost, likewise
    free: Floats  #: the speed at the start, if in motion, and what was lost, in its spread
    deviations: Floats  #: their standard deviations


class _Fit(NamedTuple):
    """A fit of the parameters."""

    values: dict[str, float]
    cost: float  #: half of the sum of the squares of the weighted errors
    errors: Floats  #: predicted minus measured: a row for each signal
    slopes: Floats  #: of the weighted errors over the values


class _Search(NamedTuple):
    """Fits the prediction to the first signals of the stretches."""

    stretches: tuple[Stretch, ...]
    vehicle: Vehicle
    integrator: str
    sizes: Floats  #: of the errors of each signal, by which it counts
    noise: float  #: [m/s] roughly, of the speed
    is_fast: bool  #: the loops are compiled

    def best(self, starts: Sequence[Mapping[str, float]]) -> _Fit:
        """Return the best of the fits that begin at these values."""
        first = [self.fit(start, _FIRST_STEPS) for start in starts]
        fit = self.fit(min(first, key=lambda fit: fit.cost).values)
        return self.across_kinks(fit)

    def fit(self, start: Mapping[str, float], max_steps: int = _STEPS) -> _Fit:
        """Fit the parameters that `start` has."""
        optimize = extra('scipy.optimize', 'identify', 'identify')
        steps = np.array([_UNKNOWN[name].step for name in start])
        low = np.array([_UNKNOWN[name].lowest for name in start])

        def errors(p: Floats) -> Floats:
            return self._weighted(dict(zip(start, p.tolist(), strict=True)))

        def slopes(p: Floats) -> Floats:
            jacobian: Floats = optimize.approx_fprime(p, errors, steps)
            return jacobian

        result = optimize.least_squares(
            errors, [*start.values()], slopes, (low, inf), x_scale='jac', max_nfev=max_steps
        )
        values = dict(zip(start, result.x.tolist(), strict=True))
        return _Fit(values, result.cost, self.errors(values), result.jac)

    def across_kinks(self, fit: _Fit) -> _Fit:
        """Return the best fit whose delays are near those of `fit`.

        The derivative over a delay jumps where a command's effect reaches a state: there a fit can
        stop beside the minimum.
        """
        step = float(np.median(np.diff(self.stretches[0].t)))
        for name in [name for name in fit.values if name.endswith('_delay')]:
            for _ in range(_ROUNDS):
                profile = self._profile(fit, name)
                delays = np.maximum(fit.values[name] + step * _SCANNED, 0.0).tolist()
                best = min(map(profile, delays), key=lambda point: point.cost)
                other = self.fit(best.values, _FIRST_STEPS)
                if not other.cost < fit.cost * (1.0 - _BETTER):
                    break
                fit = other
        return fit

    def interval(self, fit: _Fit, name: str, first: float, larger: float) -> float:
        """Return half the confidence interval of a parameter, by the profile of the error.

        It ends where the sum of squares is significantly `larger` by as much; `first` is half of
        the interval by the derivative.
        """
        profile = self._profile(fit, name)
        value = fit.values[name]
        half = first

        for sign in (-1.0, 1.0):
            before = 0.0
            for k in range(1, _WIDENINGS):
                offset = 0.25 * k * first
                if value + sign * offset < _UNKNOWN[name].lowest:
                    break

                increase = 2.0 * (profile(value + sign * offset).cost - fit.cost)
                if increase >= larger:
                    # The increase is a parabola from the last offset on.
                    share = sqrt((larger - before) / (increase - before))
                    half = max(half, offset - 0.25 * first * (1.0 - share))
                    break
                before = max(increase, 0.0)
                half = max(half, offset)
        return half

    def _profile(self, fit: _Fit, name: str) -> Callable[[float], _Point]:
        """Return a function of a parameter's value: the others are fitted by their slopes."""
        names = [*fit.values]
        other_names = [other for other in names if other != name]
        slopes = fit.slopes[:, [names.index(other) for other in other_names]]
        inverse = np.linalg.pinv(slopes)
        lowest = np.array([_UNKNOWN[other].lowest for other in other_names])

        def at(value: float) -> _Point:
            errors = self._weighted(fit.values | {name: value})
            start = np.array([fit.values[other] for other in other_names])
            fitted = np.maximum(start - inverse @ errors, lowest)
            rest = errors + slopes @ (fitted - start)
            values = fit.values | dict(zip(other_names, fitted.tolist(), strict=True))
            return _Point(values | {name: value}, 0.5 * float(rest @ rest))

        return at

    def free(self, values: Mapping[str, float]) -> int:
        """Return how many numbers are estimated besides the parameters."""
        return sum(len(self._solve(each, values).free) for each in self.stretches)

    def degrees(self, fit: _Fit) -> int:
        """Return the degrees of freedom of the errors of a fit."""
        return max(len(fit.slopes) - len(fit.values) - self.free(fit.values), 1)

    def with_certain_commands(self, values: Mapping[str, float]) -> _Search:
        """Return the search over stretches with the lost commands that are certain."""
        stretches = []
        for stretch in self.stretches:
            solved = self._solve(stretch, values)
            first = len(solved.free) - len(stretch.gaps)
            of_lost = solved.free[first:]
            deviations = solved.deviations[first:]
            stretches.append(with_certain_commands(stretch, of_lost, deviations))
        return self._replace(stretches=tuple(stretches))

    def errors(self, values: Mapping[str, float]) -> Floats:
        """Return predicted minus measured: a row for each signal."""
        errors = [self._solve(each, values).errors for each in self.stretches]
        return np.concatenate(errors, 1) * self.sizes

    def _weighted(self, values: Mapping[str, float]) -> Floats:
        """Return the errors divided by `sizes`, and those of what was lost by its spread."""
        solved = [self._solve(each, values) for each in self.stretches]
        errors = [each.errors.ravel() for each in solved]
        priors = [each.prior for each in solved]
        return np.concatenate(errors + priors)

    @np.errstate(invalid='ignore', over='ignore')  # of a car that the integrator cannot follow
    def _solve(self, stretch: Stretch, values: Mapping[str, float]) -> _Solved:
        """Return the errors with the speed at the start and what was lost as they fit best."""
        predicted, responses = self._responses(stretch, values)
        rows = stretch.counted
        errors = (predicted - stretch.measured[: len(self.sizes)])[:, rows] / self.sizes
        errors = np.clip(np.nan_to_num(errors, nan=_WORST), -_WORST, _WORST)
        count = len(responses)
        if not count:
            return _Solved(errors, np.zeros(0), np.zeros(0), np.zeros(0))
        slopes = (responses[:, :, rows] / self.sizes).reshape(count, -1)
        slopes = np.clip(np.nan_to_num(slopes), -_WORST, _WORST)

        # What was lost has a spread of 1; nothing is known of the speed at the start.
        weight = max(self.noise, _NO_NOISE) / float(self.sizes[0, 0])
        priors = weight * np.eye(count)[count - len(stretch.gaps) :]
        # `einsum`: for such small products the threads of a BLAS take longer on a busy machine.
        normal = np.einsum('ik,jk->ij', slopes, slopes) + priors.T @ priors
        inverse = np.linalg.pinv(normal, hermitian=True)
        free = -inverse @ np.einsum('ik,k->i', slopes, errors.ravel())
        errors = errors + np.einsum('ik,i->k', slopes, free).reshape(errors.shape)
        return _Solved(errors, priors @ free, free, weight * np.sqrt(np.diag(inverse)))

    def _responses(self, stretch: Stretch, values: Mapping[str, float]) -> tuple[Floats, Floats]:
        """Return the prediction, and how it depends on what is free: shape `(free, signals, n)`."""
        car = self._car(values)
        v = float(stretch.measured[0, 0]) if stretch.in_motion else 0.0
        count = len(self.sizes)
        predicted = predict(stretch, car, v, is_fast=self.is_fast)[:count]
        along = free_responses(stretch, car, predicted[0])

        responses = np.zeros((len(along), *predicted.shape))
        responses[:, 0] = along
        if stretch.in_motion and count > 1:
            faster = predict(stretch, car, v + _FASTER, is_fast=self.is_fast)
            responses[0] = (faster - predicted) / _FASTER
        return predicted, responses

    def _car(self, values: Mapping[str, float]) -> CarModel:
        """Return the car with these values."""
        mass = self.vehicle.mass
        # `_replace` refuses nothing: on the way a resistance may be below zero.
        vehicle = self.vehicle._replace(
            air_drag_coeff=values['drag_per_mass'] * mass,
            friction=values['friction_per_mass'] * mass,
        )
        tyres = {name: values[name] for name in _TYRES if name in values}

        return CarModel(
            vehicle=vehicle,
            motor=_actuator(values, 'motor'),
            servo=_actuator(values, 'servo') if 'servo_delay' in values else None,
            lateral=LateralParameters()._replace(**tyres) if tyres else None,
            integrator=self.integrator,
        )


class _Resamples(NamedTuple):
    """Resamples of the residuals of a fit, as they are sent to a worker."""

    search: _Search
    values: dict[str, float]  #: of the fit
    errors: Floats  #: of the fit
    inflation: float  #: of the residuals, see `resampled`
    seed: int
    numbers: range  #: of the resamples

    @classmethod
    def of(cls, search: _Search, fit: _Fit, seed: int) -> _Resamples:
        """Return no resamples yet of the residuals of a fit."""
        inflation = sqrt(len(fit.slopes) / search.degrees(fit))
        return cls(search, fit.values, fit.errors, inflation, seed, range(0))


def _fits_of_resamples(
    resamples: _Resamples, count: int, executor: Executor | None
) -> dict[str, Floats]:
    """Return the values of each parameter, fitted to each of `count` resamples."""
    fits = np.empty((count, len(resamples.values)))
    if executor is None:
        fits[:], _ = _fit_resamples(resamples._replace(numbers=range(count)))
        return dict(zip(resamples.values, fits.T, strict=True))

    sizes = PieceSizes(count, workers_of(executor))
    pieces = (resamples._replace(numbers=numbers) for numbers in sizes.ranges())
    for piece, future in finished_pieces(executor, _fit_resamples, pieces):
        of_piece, duration = result_of(future)
        sizes.measured(piece.numbers, duration)
        fits[piece.numbers.start : piece.numbers.stop] = of_piece
    return dict(zip(resamples.values, fits.T, strict=True))


def _fit_resamples(resamples: _Resamples) -> tuple[Floats, float]:
    """Return the values that fit each resample, and the duration [s]; called by workers."""
    began = time.perf_counter()
    search = resamples.search
    fits = []
    for number in resamples.numbers:
        # By its number, so that each is the same, whichever worker fits it.
        random = np.random.default_rng([resamples.seed, number])
        stretches = resampled(search.stretches, resamples.errors, resamples.inflation, random)
        other = search._replace(stretches=stretches)
        fit = other.across_kinks(other.fit(resamples.values))
        fits.append([fit.values[name] for name in resamples.values])
    return np.array(fits), time.perf_counter() - began


def _with_percentiles(estimate: Estimate, fits: Floats) -> Estimate:
    """Return an estimate with the interval of fits to resamples, unless it cannot be known."""
    if estimate.interval == inf:
        return estimate
    return estimate._replace(interval=half_interval(estimate.value, fits))


def _actuator(values: Mapping[str, float], name: str) -> Actuator:
    """Return the actuator of this name with these values."""
    lag = values.get(f'{name}_lag', 0.0)
    return Actuator()._replace(delay=values[f'{name}_delay'], lag=lag)


def _size(errors: Floats) -> Floats:
    """Return the root mean square of each row, shape `(n, 1)`."""
    size: Floats = np.maximum(np.sqrt(np.mean(errors**2, 1, keepdims=True)), _NO_NOISE)
    return size


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
    n = len(errors)
    energy = errors @ errors
    if energy < n * _NO_NOISE**2:
        return nan
    lags = np.arange(1, _LAGS + 1)
    correlations = np.array([errors[lag:] @ errors[:-lag] for lag in lags]) / energy
    statistic = n * (n + 2) * np.sum(correlations**2 / (n - lags))
    return float(special.gammaincc(_LAGS / 2.0, statistic / 2.0))


def _remarks(
    estimates: Mapping[str, Estimate], whiteness: Mapping[str, float], *, is_linearised: bool
) -> Iterator[str]:
    """Yield a sentence for each parameter, and each signal, that the logs do not show well."""
    for name, estimate in estimates.items():
        interval = estimate.interval
        if interval == inf:
            yield f'{name} cannot be identified: no measured signal depends on it alone'
        elif estimate.is_negative:
            yield (
                f'{name} is negative, as of no car: check that v_x is in m/s, motor in m/s² and '
                'theta_deg positive uphill'
            )
        elif not name.endswith('_delay') and interval >= 0.5 * abs(estimate.value):
            size = f'{interval:.2g} {estimate.unit}'
            yield f'{name} cannot be identified: it is known to ±{size} only'

    for signal, p in whiteness.items():
        if p < _SIGNIFICANT:
            remark = (
                f'the residuals of {signal} are not white noise (p = {p:.2g}): the car does more '
                'than the model'
            )
            width = 'too narrow' if is_linearised else 'often still too narrow'
            yield f'{remark}, and the intervals are {width}'


def _remark_on_units(parts: Sequence[Stretch], vehicle: Vehicle) -> list[str]:
    """Return a sentence if the speed changes by a multiple of what is commanded."""
    gain = gain_of(parts, vehicle)
    low, high = _GAINS
    if low < gain < high:
        return []

    remark = (
        f'the speed changes {gain:.2g} times as much as was commanded: expected v_x in m/s (in '
        'km/h it changes 3.6 times as much) and motor in m/s²'
    )
    return [remark]
