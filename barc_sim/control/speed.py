"""Speed controllers: their protocol, the PID, the LQR, and an adapter for a user's object."""

from __future__ import annotations

import inspect
from copy import deepcopy
from inspect import signature
from math import inf, isfinite, isnan, nan, sqrt
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

from barc_sim.errors import UserError
from barc_sim.interfaces.parameters import ParameterDeclaration
from barc_sim.vehicle.law import law

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    Column = Any  #: a list of numbers in Python, an array in compiled code


class Gain(NamedTuple):
    """A gain of a controller: its default, unit, meaning and limits."""

    default: float
    unit: str
    meaning: str
    slider: float  #: the page's slider goes from 0 to this value
    between: tuple[float, float] = (0.0, 1e6)  #: what is allowed, ends included


class Tunable(Protocol):
    """An object that declares its gains; each is an attribute, which may be set at any time."""

    gains: Mapping[str, Gain]


class Controller(Protocol):
    """A speed controller, and the declaration of its gains and terms.

    Parameters of the node `controller`, `--gain`, the page's sliders, the log's columns, the
    messages in the bag and the plots follow from `gains` and `terms`. Each name in them is an
    attribute of the controller, too: a gain may be set at any time, and a term has its value of the
    latest call. `acc_calculate` keeps its output within `[output_min, output_max]`.
    """

    gains: Mapping[str, Gain]
    terms: Mapping[str, str]  #: [m/s²] parts of the output: their meaning by name
    output_min: float  #: [m/s²]
    output_max: float  #: [m/s²]
    saturated: bool  #: whether a limit cut the latest output

    def reset(self) -> None:
        """Forget the past: the next call is the first."""

    def acc_calculate(self, speed_reference: float, speed_current: float, dt: float, /) -> float:
        """Return the acceleration [m/s²] for speeds in m/s, `dt` seconds after the last call."""


def read_term(controller: object, name: str) -> float:
    """Return an attribute of a controller; NaN if it is missing, or not a number."""
    try:
        return float(getattr(controller, name, nan))
    except (TypeError, ValueError):
        return nan


def check_gains(controller: Tunable) -> None:
    """Raise UserError if a gain is beyond its limits."""
    set_gains(controller, {name: getattr(controller, name) for name in controller.gains})


def check_values(gains: Mapping[str, Gain], values: Mapping[str, float]) -> None:
    """Raise UserError if a value is that of no gain, or beyond the limits of its gain."""
    unknown = values.keys() - gains.keys()
    if unknown:
        raise UserError(
            f'{", ".join(unknown)}: this controller has no such gain, but {", ".join(gains)}'
        )
    for name, value in values.items():
        gain = gains[name]
        ParameterDeclaration(name, gain.default, '', gain.between).check(value)


def set_gains(controller: Tunable, values: Mapping[str, float]) -> None:
    """Set gains of a controller by name.

    UserError: it has no such gain, or one is beyond its limits.
    """
    check_values(controller.gains, values)
    for name, value in values.items():
        setattr(controller, name, value)


def take_gains(controller: Tunable, values: Mapping[str, float]) -> None:
    """Set all gains of a controller as `set_gains` does; missing ones get their defaults."""
    defaults = {name: gain.default for name, gain in controller.gains.items()}
    set_gains(controller, {**defaults, **values})


#: The run's gains. On the lab's road: 0.021 m/s RMS and 0.126 m/s at most after the first 10 m.
KP = 30.0
KI = 200.0
KD = 0.1
#: Of a gain: a user's controller may have its error the other way round.
_EITHER_SIGN = (-1e6, 1e6)
SPEED_REFERENCE = 8.0
ACCELERATION_LIMIT = 8.0
#: [m/s²] Stands for none: the lab's car has no limit.
NO_LIMIT = 1e6
#: [s] dt of a controller's first call, which has no call before it: the lab's step.
FIRST_DT = 0.02


class OfRecord:
    """An attribute of a controller that is a field of its `law_gains`, the record of its law.

    So the record is made when a gain changes, and not for each call of the law.
    """

    def __set_name__(self, owner: type, name: str) -> None:
        """Take the name of the field."""
        self._name = name

    def __get__(self, controller: Any, owner: type | None = None) -> float:  # noqa: ANN401
        """Return the present value."""
        value: float = getattr(controller.law_gains, self._name)
        return value

    def __set__(self, controller: Any, value: float) -> None:  # noqa: ANN401
        """Change the record."""
        controller.law_gains = controller.law_gains._replace(**{self._name: value})


@law
def limited_output(raw: float, minimum: float, maximum: float) -> tuple[float, bool]:
    """Return a controller's output within its limits, and whether a limit cut it.

    NaN is returned as it is.
    """
    if raw > maximum:
        return maximum, True
    if raw < minimum:
        return minimum, True
    return raw, False


class PidGains(NamedTuple):
    """The gains of a PID, and the limits of its output [m/s²]."""

    kp: float  #: [1/s]
    ki: float  #: [1/s²]
    kd: float
    output_min: float
    output_max: float


class PidMemory(NamedTuple):
    """What a PID keeps from one call to the next."""

    integral: float = 0.0  #: [m/s²]
    previous: float = nan  #: [m/s] the latest measurement; NaN: the next call is the first


class PidTerms(NamedTuple):
    """The output of a PID and two terms of its sum; the integral term is in `PidMemory`."""

    output: float  #: [m/s²] within the limits
    proportional: float  #: [m/s²]
    derivative: float  #: [m/s²]
    saturated: bool  #: whether a limit cut the output


@law
def pid(
    memory: PidMemory, gains: PidGains, reference: float, measured: float, dt: float
) -> tuple[PidMemory, PidTerms]:
    """Return the memory and the terms of a PID after a call; the class `PID` has its equations.

    `reference` and `measured` are in m/s, and `dt` [s] is the time since the call before.
    """
    error = reference - measured
    proportional = gains.kp * error
    increment = 0.0
    derivative = 0.0
    if not isnan(memory.previous) and dt > 0.0:
        increment = gains.ki * error * dt
        derivative = -gains.kd * (measured - memory.previous) / dt

    raw = proportional + memory.integral + increment + derivative
    output, saturated = limited_output(raw, gains.output_min, gains.output_max)
    if raw > output:
        increment = min(increment, 0.0)
    elif raw < output:
        increment = max(increment, 0.0)

    integral = memory.integral
    if isfinite(output):
        integral += increment
    previous = measured if isfinite(error) else nan
    return PidMemory(integral, previous), PidTerms(output, proportional, derivative, saturated)


class PID:
    """A PID controller in parallel form, with limited output.

    With the error e = reference - measurement, over each interval dt::

        u = kp e + I + D      I = Σ ki e dt      D = -kd Δmeasurement / dt

    and the output is `u` limited to `[output_min, output_max]`.

    - Anti-windup is by conditional integration ("clamping"; Åström and Hägglund, "Advanced PID
      Control", 3.5): while the output is limited, the integral does not move further into
      the limit.
    - The derivative is that of the measurement, so that a changed reference does not kick. The
      first sample has no predecessor: its derivative is 0, and it adds nothing to the integral.
    - The integral has the unit of the output: a changed `ki` applies from then on.
    - If `dt` is not positive (two samples of one instant), I does not change and D is zero.
    - A sample that is not finite has no effect on later ones: `u` follows it (NaN gives NaN), but
      I does not change, and the next sample counts as the first.

    Gains and limits can be changed at any time.

    Attributes
    ----------
    memory
        The record that `pid` takes and returns.
    proportional, derivative, saturated
        [m/s²] terms of the latest call, and whether its output was limited.

    Examples
    --------
    >>> pid = PID(kp=2.0, ki=0.5, kd=0.0, output_max=8.0)
    >>> pid.acc_calculate(8.0, 7.0)
    2.0
    >>> pid.acc_calculate(8.0, 7.0, dt=0.02)
    2.01
    """

    gains: Mapping[str, Gain] = {
        'kp': Gain(KP, '1/s', 'proportional gain', 100.0, _EITHER_SIGN),
        'ki': Gain(KI, '1/s²', 'integral gain', 400.0, _EITHER_SIGN),
        'kd': Gain(KD, '-', 'derivative gain', 5.0, _EITHER_SIGN),
    }
    terms: Mapping[str, str] = {
        'proportional': 'kp times the error',
        'integral': 'the integral of ki times the error',
        'derivative': 'kd times the rate of change of the measured speed, negative',
    }

    #: Gains that show what each term does, by the name that the page's button has.
    presets: Mapping[str, Mapping[str, float]] = {
        'P': {'kp': 4.0, 'ki': 0.0, 'kd': 0.0},
        'PI': {'kp': 4.0, 'ki': 8.0, 'kd': 0.0},
        'PID': {'kp': 4.0, 'ki': 8.0, 'kd': 0.5},
        'Tuned': {'kp': KP, 'ki': KI, 'kd': KD},
        'Too much I': {'kp': 0.3, 'ki': 40.0, 'kd': 0.0},
    }

    kp = OfRecord()
    ki = OfRecord()
    kd = OfRecord()
    output_min = OfRecord()
    output_max = OfRecord()

    def __init__(
        self,
        kp: float = KP,
        ki: float = KI,
        kd: float = KD,
        *,
        dt: float = 0.02,
        output_min: float = -inf,
        output_max: float = inf,
    ) -> None:
        """Start at rest; `dt` [s] is the interval between calls that do not give one.

        Raises
        ------
        UserError
            if a gain is beyond its limits, or `output_min` is not below `output_max`.
        """
        if not output_min < output_max:
            raise UserError(f'output_min={output_min!r} must be below output_max={output_max!r}')
        #: The present gains and limits, as `pid` takes them.
        self.law_gains = PidGains(kp, ki, kd, output_min, output_max)
        self.dt = dt
        check_gains(self)
        self.reset()

    def reset(self) -> None:
        """Forget the past: the next call is the first."""
        self.memory = PidMemory()
        self.proportional = 0.0
        self.derivative = 0.0
        self.saturated = False

    @property
    def previous(self) -> float | None:
        """The latest measurement [m/s]; None: the next call is the first."""
        return None if isnan(self.memory.previous) else self.memory.previous

    @property
    def integral(self) -> float:
        """The integral term [m/s²], with what the latest call added."""
        return self.memory.integral

    @integral.setter
    def integral(self, value: float) -> None:
        self.memory = self.memory._replace(integral=value)

    def acc_calculate(
        self, speed_reference: float, speed_current: float, dt: float | None = None
    ) -> float:
        """Return the acceleration [m/s²] for speeds in m/s, `dt` seconds after the last call."""
        dt = self.dt if dt is None else dt
        self.memory, terms = pid(self.memory, self.law_gains, speed_reference, speed_current, dt)
        self.proportional = terms.proportional
        self.derivative = terms.derivative
        self.saturated = terms.saturated
        return terms.output


def speed_controller(
    kp: float = KP, ki: float = KI, kd: float = KD, limit: float = ACCELERATION_LIMIT
) -> PID:
    """Return the run's controller: a PID whose output is within ±`limit` [m/s²]."""
    return PID(kp, ki, kd, output_min=-limit, output_max=limit)


@law
def feedback_gain(speed_weight: float, effort_weight: float, dt: float) -> float:
    """Return K [1/s] that minimizes Σ q e² + r a² for e⁺ = e - dt a, by a = K e.

    The scalar Riccati equation P = q + P - (dt P)² / (r + dt² P) has one positive root::

        P = (q dt² + √(q² dt⁴ + 4 q r dt²)) / (2 dt²)      K = dt P / (r + dt² P)

    (Åström and Wittenmark, "Computer-Controlled Systems", 11.3.)
    """
    weighted = speed_weight * dt * dt
    cost = (weighted + sqrt(weighted * (weighted + 4.0 * effort_weight))) / (2.0 * dt * dt)
    return dt * cost / (effort_weight + dt * dt * cost)


class LqrGains(NamedTuple):
    """The weights of a regulator, the gain of its observer, and the limits of its output [m/s²]."""

    speed_weight: float  #: [1/s²]
    effort_weight: float
    observer_gain: float
    dt: float  #: [s] between calls, for which K is computed
    output_min: float
    output_max: float


class LqrMemory(NamedTuple):
    """What a regulator keeps from one call to the next."""

    compensation: float = 0.0  #: [m/s²] the estimated disturbance, negative
    output: float = 0.0  #: [m/s²]
    previous: float = nan  #: [m/s] the latest measurement; NaN: the next call is the first


class LqrTerms(NamedTuple):
    """What a regulator returns, and how it came about; the memory has the other term."""

    output: float  #: [m/s²] within the limits
    feedback: float  #: [m/s²]
    saturated: bool  #: whether a limit cut the output


@law
def lqr(
    memory: LqrMemory, gains: LqrGains, reference: float, measured: float, dt: float
) -> tuple[LqrMemory, LqrTerms]:
    """Return the memory and the terms of a regulator after a call; `LQR` has its equations.

    `reference` and `measured` are in m/s, and `dt` [s] is the time since the call before.
    """
    compensation = memory.compensation
    if not isnan(memory.previous) and dt > 0.0:
        disturbance = (measured - memory.previous) / dt - memory.output
        if isfinite(disturbance):
            compensation -= gains.observer_gain * (disturbance + compensation)

    error = reference - measured
    feedback = feedback_gain(gains.speed_weight, gains.effort_weight, gains.dt) * error
    raw = feedback + compensation
    output, saturated = limited_output(raw, gains.output_min, gains.output_max)

    previous = measured if isfinite(error) else nan
    return LqrMemory(compensation, output, previous), LqrTerms(output, feedback, saturated)


class LQR:
    """A linear-quadratic regulator with a disturbance observer, and limited output.

    With the error e = reference - measurement, and the disturbance d, the acceleration that is not
    commanded (gravity along the road, drag, friction), in each interval dt::

        d ← d + l (Δmeasurement / dt - u_before - d)      u = K e - d

    K is the solution of the scalar Riccati equation for the weights q = `speed_weight` of the
    error and r = `effort_weight` of the acceleration. The observer, with gain l = `observer_gain`
    from 0 to 1, uses the output after the limits, and so does not wind up (Åström and Wittenmark,
    "Computer-Controlled Systems", 11.4: a Luenberger observer of a constant disturbance).

    At the first sample, and at one after a sample that is not finite, d does not change.

    Examples
    --------
    >>> from barc_sim import simulate, summary
    >>> log = simulate(controller=LQR(speed_weight=100.0))
    >>> print(f'{summary(log).rms_error_after_run_up:.3f} m/s')
    0.020 m/s
    """

    gains: Mapping[str, Gain] = {
        'speed_weight': Gain(400.0, '1/s²', 'weight of the speed error', 2000.0, (1e-3, 1e6)),
        'effort_weight': Gain(1.0, '-', 'weight of the acceleration', 10.0, (1e-3, 1e6)),
        'observer_gain': Gain(0.5, '-', 'gain of the disturbance observer', 1.0, (0.0, 1.0)),
    }
    terms: Mapping[str, str] = {
        'feedback': 'K times the error',
        'compensation': 'the estimated disturbance, negative',
    }
    speed_weight = OfRecord()
    effort_weight = OfRecord()
    observer_gain = OfRecord()
    dt = OfRecord()
    output_min = OfRecord()
    output_max = OfRecord()

    def __init__(
        self,
        *,
        dt: float = 0.02,
        output_min: float = -inf,
        output_max: float = inf,
        **gains: float,
    ) -> None:
        """Start at rest with these gains; K is computed for the interval `dt` [s]."""
        #: The present gains and limits, as `lqr` takes them.
        self.law_gains = LqrGains(nan, nan, nan, dt, output_min, output_max)
        take_gains(self, gains)
        self.reset()

    def reset(self) -> None:
        """Forget the past: the next call is the first."""
        self.memory = LqrMemory()
        self.feedback = 0.0
        self.saturated = False

    @property
    def compensation(self) -> float:
        """The estimated disturbance [m/s²], negative."""
        return self.memory.compensation

    def acc_calculate(
        self, speed_reference: float, speed_current: float, dt: float | None = None
    ) -> float:
        """Return the acceleration [m/s²] for speeds in m/s, `dt` seconds after the last call."""
        dt = self.dt if dt is None else dt
        self.memory, terms = lqr(self.memory, self.law_gains, speed_reference, speed_current, dt)
        self.feedback = terms.feedback
        self.saturated = terms.saturated
        return terms.output


class SpeedGains(NamedTuple):
    """One of the speed laws here; only the gains of this law have an effect."""

    is_lqr: bool  #: otherwise it is the PID
    pid: PidGains
    lqr: LqrGains


class SpeedMemory(NamedTuple):
    """What a speed law keeps from one call to the next."""

    pid: PidMemory
    lqr: LqrMemory


_NO_PID = PidGains(nan, nan, nan, nan, nan)
_NO_LQR = LqrGains(nan, nan, nan, nan, nan, nan)


def speed_gains(controller: Controller, limit: float) -> SpeedGains | None:
    """Return the law of a controller with its present gains, its output within ±`limit` [m/s²].

    The numbers are floats. None: it is neither a `PID` nor an `LQR`.
    """
    if type(controller) is PID:
        of_pid = PidGains._make(map(float, controller.law_gains))
        of_pid = of_pid._replace(output_min=-limit, output_max=limit)
        return SpeedGains(is_lqr=False, pid=of_pid, lqr=_NO_LQR)
    if type(controller) is LQR:
        of_lqr = LqrGains._make(map(float, controller.law_gains))
        of_lqr = of_lqr._replace(output_min=-limit, output_max=limit)
        return SpeedGains(is_lqr=True, pid=_NO_PID, lqr=of_lqr)
    return None


@law
def with_speed_gains(gains: SpeedGains, values: Column) -> SpeedGains:
    """Return a speed law with other gains, which are in the order of its class's `gains`."""
    of_pid = gains.pid
    of_lqr = gains.lqr
    if gains.is_lqr:
        of_lqr = LqrGains(
            values[0], values[1], values[2], of_lqr.dt, of_lqr.output_min, of_lqr.output_max
        )
    else:
        of_pid = PidGains(values[0], values[1], values[2], of_pid.output_min, of_pid.output_max)
    return SpeedGains(gains.is_lqr, of_pid, of_lqr)


@law
def accelerate(
    memory: SpeedMemory, gains: SpeedGains, reference: float, measured: float, dt: float
) -> tuple[SpeedMemory, float]:
    """Return the memory of a speed law after a call, and the acceleration [m/s²].

    The arguments are those of `pid` and `lqr`.
    """
    if gains.is_lqr:
        of_lqr, regulated = lqr(memory.lqr, gains.lqr, reference, measured, dt)
        return SpeedMemory(memory.pid, of_lqr), regulated.output
    of_pid, controlled = pid(memory.pid, gains.pid, reference, measured, dt)
    return SpeedMemory(of_pid, memory.lqr), controlled.output


_MEMBERS = ('gains', 'terms', 'output_min', 'output_max', 'saturated', 'reset')


def as_controller(controller: Any) -> Controller:  # noqa: ANN401 (any object of the user's)
    """Return `controller` itself if it is a whole `Controller`, an adapter around it otherwise.

    The lab's `acc_calculate(speed_reference, speed_current)` is enough; a third argument receives
    dt. Gains and terms are those that the object declares, or those of the PID.

    Raises
    ------
    UserError
        if it is not an object with such a method.
    """
    if isinstance(controller, type):
        raise UserError(
            f'controller={controller.__name__} is a class; expected an object, such as '
            f'{controller.__name__}(kp=30.0, ki=200.0, kd=0.1)'
        )
    if not callable(getattr(controller, 'acc_calculate', None)):
        raise UserError(
            f'controller={controller!r} has no method '
            'acc_calculate(speed_reference, speed_current): expected an object with one'
        )

    takes_dt = _dt_argument(controller.acc_calculate) is not None
    if takes_dt and all(hasattr(controller, name) for name in _MEMBERS):
        return controller  # type: ignore[no-any-return]

    def new(**values: float) -> Any:  # noqa: ANN401 (as above)
        fresh = deepcopy(controller)
        for name, value in values.items():
            setattr(fresh, name, value)
        return fresh

    declared = getattr(controller, 'gains', PID.gains)
    gains = {name: gain for name, gain in declared.items() if hasattr(controller, name)}
    values = {name: getattr(controller, name) for name in gains}
    return SpeedAdapter(new, gains, values, getattr(controller, 'terms', PID.terms))


class Adapter:
    """Keeps an object of the user's, with its gains and terms: base of adapters to a protocol.

    The terms are the object's attributes of these names, NaN if one is missing or not a number.
    """

    def __init__(
        self,
        new: Callable[..., Any],
        gains: Mapping[str, Gain],
        values: Mapping[str, float],
        terms: Mapping[str, str],
    ) -> None:
        """Take objects from `new`, called with the gains by name; a reset takes a fresh one."""
        self._new = new
        self.gains = gains
        self.terms = terms
        self.__dict__.update(values)
        self.reset()

    def reset(self) -> None:
        """Begin with a fresh object."""
        self._latest_gains = self._values()
        self._object = self._new(**self._latest_gains)
        self.__dict__.update(dict.fromkeys(self.terms, nan))

    def _call(self, method: str, *args: Any, **options: Any) -> Any:  # noqa: ANN401 (as above)
        """Call a method of the object: before, set changed gains; after, read the terms."""
        values = self._values()
        if values != self._latest_gains:
            self._latest_gains = values
            self._set(values)

        output = getattr(self._object, method)(*args, **options)

        self.__dict__.update({name: self._read(name) for name in self.terms})
        return output

    def _values(self) -> dict[str, float]:
        return {name: self.__dict__[name] for name in self.gains}

    def _set(self, values: Mapping[str, float]) -> None:
        for name, value in values.items():
            setattr(self._object, name, value)

    def _read(self, name: str) -> float:
        return read_term(self._object, name)


class SpeedAdapter(Adapter):
    """A `Controller` around an object that may lack limits of its output and a reset.

    `saturated` is true if the adapter or the object limited the output.
    """

    output_min = -inf
    output_max = inf

    def reset(self) -> None:
        """Begin with a fresh object."""
        super().reset()
        self._dt = _dt_argument(self._object.acc_calculate)
        self.saturated = False

    def acc_calculate(self, speed_reference: float, speed_current: float, dt: float) -> float:
        """Return the acceleration [m/s²] for speeds in m/s, `dt` seconds after the last call."""
        arguments = [speed_reference, speed_current]
        options = {}
        if self._dt == '':
            arguments.append(dt)
        elif self._dt is not None:
            options[self._dt] = dt
        raw = self._call('acc_calculate', *arguments, **options)

        output = min(max(raw, self.output_min), self.output_max)
        self.saturated = output != raw or self._read('saturated') == 1.0
        return float(output)


def _takes(accepted: inspect.Signature, count: int) -> bool:
    """Return whether a method can be called with so many numbers."""
    try:
        accepted.bind(*[0.0] * count)
    except TypeError:
        return False
    return True


def _dt_argument(method: Any) -> str | None:  # noqa: ANN401 (any object of the user's)
    """Return the name of a method's argument dt; empty: by position; None: it takes no dt."""
    accepted = signature(method)
    parameters = accepted.parameters
    if 'dt' in parameters and parameters['dt'].kind is not inspect.Parameter.POSITIONAL_ONLY:
        return 'dt'

    if _takes(accepted, 2):
        return None
    if _takes(accepted, 3):
        return ''
    raise UserError(
        f'acc_calculate takes ({", ".join(parameters)}): expected (speed_reference, speed_current)'
    )
