"""Steering laws: the steering angle for a car's position on its track; and the speed profile.

`steer_calculate(e_y, e_psi, speed, curvature)` returns the steering angle, as `acc_calculate`
returns the acceleration. `curvature(d)` returns the curvature of the centre line `d` metres ahead
[1/m].

On a circle of curvature κ the kinematic bicycle's centre of mass stays on the line with::

    tan δ = L κ / √(1 - (l_r κ)²)        e_psi = -asin(l_r κ)

A law that brings e_psi to zero instead keeps an error e_y on every arc.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from copy import deepcopy
from dataclasses import dataclass
from math import asin, atan2, cos, inf, nan, sin, sqrt
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

from barc_sim.control.speed import Adapter, Gain, OfRecord, limited_output, take_gains
from barc_sim.errors import UserError
from barc_sim.vehicle.bike_model import L_F, L_R
from barc_sim.vehicle.law import law
from barc_sim.vehicle.track import CentreLine, Frenet, beside_arc, curvature_at

if TYPE_CHECKING:
    from barc_sim.vehicle.track import Track

    Column = Any  #: a tuple of numbers in Python, an array in compiled code

#: Distance ahead [m] to the curvature of the centre line [1/m].
Curvature = Callable[[float], float]
STEERING_LIMIT = 0.5  #: [rad] either way
#: Before the names of a lane controller's gains among parameters, and of its terms in a log.
LANE = 'lane.'
POINTS = 8  #: of the centre line between the car and the point that it pursues


class LaneController(Protocol):
    """A steering law; `gains`, `terms` [rad] and `reset`, as of a `Controller`, are optional."""

    def steer_calculate(
        self, e_y: float, e_psi: float, speed: float, curvature: Curvature, /
    ) -> float:
        """Return the front angle [rad] for errors in metres and radians, and a speed in m/s."""


class SteeringLaw(LaneController, Protocol):
    """A whole steering law, which gains and terms are attributes of, as of a `Controller`."""

    gains: Mapping[str, Gain]
    terms: Mapping[str, str]  #: [rad]
    #: [m/s²] in place of the speed controller's; None: it does not plan the speed.
    acceleration: float | None
    #: The latest plan, an array of shape `(n, 2)`: distance ahead and e_y [m]; None: it makes none.
    prediction: Any

    def reset(self) -> None:
        """Forget the past: the next call is the first."""


class LaneTerms(NamedTuple):
    """The terms [rad] of a steering law, whose sum is the angle."""

    feedforward: float  #: for the track ahead
    of_e_y: float  #: corrects the lateral error
    of_e_psi: float  #: corrects the heading error


@law
def steering_angle(terms: LaneTerms) -> float:
    """Return the front angle [rad], the sum of a law's terms."""
    return terms.feedforward + terms.of_e_y + terms.of_e_psi


@law
def steady_turn(curvature: float, l_f: float = L_F, l_r: float = L_R) -> tuple[float, float]:
    """Return steering angle and e_psi [rad] of the steady turn of this curvature [1/m].

    Examples
    --------
    >>> steer, e_psi = steady_turn(1 / 20)
    >>> print(f'{steer:.4f} {e_psi:.4f}')
    0.1493 -0.0751
    """
    turn = max(-1.0, min(l_r * curvature, 1.0))
    return atan2((l_f + l_r) * curvature, sqrt(1.0 - turn * turn)), -asin(turn)


class PursuitGains(NamedTuple):
    """The gains of pure pursuit, and the distances of the axles [m]."""

    look_ahead: float  #: [m]
    look_ahead_time: float  #: [s]
    l_f: float
    l_r: float


@law
def pursuit_step(gains: PursuitGains, speed: float) -> float:
    """Return the distance [m] between the points of the centre line, at a speed in m/s."""
    return (gains.look_ahead + gains.look_ahead_time * abs(speed)) / POINTS


@law
def pure_pursuit(
    gains: PursuitGains, e_y: float, e_psi: float, step: float, curvatures: Column
) -> LaneTerms:
    """Return the terms of pure pursuit; the class `PurePursuit` has its equation.

    `curvatures` [1/m] are those in the middle of each of `POINTS` pieces of the centre line, which
    are `step` [m] long and begin beside the car.
    """
    # The centre line ahead, in the frame of its point beside the car.
    x = 0.0
    y = 0.0
    heading = 0.0
    for curvature in curvatures:
        turn = curvature * step
        x += step * cos(heading + 0.5 * turn)
        y += step * sin(heading + 0.5 * turn)
        heading += turn

    # The point that is pursued, from the rear axle.
    x += gains.l_r * cos(e_psi)
    y = y - e_y + gains.l_r * sin(e_psi)
    direction = atan2(y, x) - e_psi
    across = 2.0 * (gains.l_f + gains.l_r) * sin(direction)
    return LaneTerms(atan2(across, sqrt(x * x + y * y)), 0.0, 0.0)


class StanleyGains(NamedTuple):
    """The gains of Stanley's law, and the distance of the front axle [m]."""

    k: float  #: [1/s]
    v_soft: float  #: [m/s]
    l_f: float


@law
def stanley(
    gains: StanleyGains, e_y: float, e_psi: float, speed: float, curvature: float
) -> LaneTerms:
    """Return the terms of Stanley's law; the class `Stanley` has its equation.

    `curvature` [1/m] is that of the centre line beside the car.
    """
    ahead = gains.l_f * cos(e_psi)
    across = e_y + gains.l_f * sin(e_psi)
    front, turned = beside_arc(curvature, ahead, across)
    of_e_y = -atan2(gains.k * front, gains.v_soft + abs(speed))
    return LaneTerms(turned, of_e_y, -e_psi)


class LaneLqrGains(NamedTuple):
    """The weights of the regulator of the lane, and the distances of the axles [m]."""

    q_e_y: float  #: [rad²/m²]
    q_e_psi: float
    l_f: float
    l_r: float


@law
def lane_feedback(gains: LaneLqrGains) -> tuple[float, float]:
    """Return k1 [rad/m] and k2 of the regulator; the class `LaneLQR` has their equations."""
    k1 = sqrt(gains.q_e_y)
    length = gains.l_f + gains.l_r
    root = gains.q_e_y * (gains.l_r * gains.l_r) + gains.q_e_psi + 2.0 * length * k1
    return k1, sqrt(root) - k1 * gains.l_r


@law
def lane_lqr(
    gains: LaneLqrGains, e_y: float, e_psi: float, curvature: float, ahead: float
) -> LaneTerms:
    """Return the terms of the regulator; the class `LaneLQR` has its equations.

    `curvature` [1/m] is that of the centre line beside the car, `ahead` the one for which it
    steers: the same, unless the steering has a delay.
    """
    k1, k2 = lane_feedback(gains)
    feedforward, steady = steady_turn(curvature, gains.l_f, gains.l_r)
    if ahead != curvature:
        feedforward, _ = steady_turn(ahead, gains.l_f, gains.l_r)
    return LaneTerms(feedforward, -k1 * e_y, -k2 * (e_psi - steady))


class LaneLaw(ABC):
    """Base of the laws here: gains as attributes, and three terms."""

    gains: Mapping[str, Gain] = {}
    terms: Mapping[str, str] = {
        'feedforward': 'steering angle for the track ahead',
        'of_e_y': 'correction of the lateral error',
        'of_e_psi': 'correction of the heading error',
    }
    acceleration: float | None = None  #: [m/s²] of a law that plans the speed
    prediction: Any = None  #: of a law that makes plans

    def __init__(self, *, l_f: float = L_F, l_r: float = L_R, **gains: float) -> None:
        """Take gains by name, and the distances of the axles [m]."""
        self.l_f = l_f
        self.l_r = l_r
        take_gains(self, gains)
        self.reset()

    @abstractmethod
    def steer_calculate(
        self, e_y: float, e_psi: float, speed: float, curvature: Curvature
    ) -> float:
        """Return the front angle [rad] for errors in metres and radians, and a speed in m/s."""

    def reset(self) -> None:
        """Forget the past: the next call is the first."""
        self.feedforward = 0.0
        self.of_e_y = 0.0
        self.of_e_psi = 0.0

    def _sum(self, terms: LaneTerms) -> float:
        self.feedforward = terms.feedforward
        self.of_e_y = terms.of_e_y
        self.of_e_psi = terms.of_e_psi
        return steering_angle(terms)


class PurePursuit(LaneLaw):
    """Steers the rear axle along a circle through a point of the centre line ahead.

    With d the distance of that point and η its direction from the car's axis (Coulter,
    "Implementation of the pure pursuit path tracking algorithm", CMU-RI-TR-92-01)::

        δ = atan(2 L sin η / d)

    All of it is the term `feedforward`.

    Examples
    --------
    >>> from barc_sim import PurePursuit, lap
    >>> print(f'{abs(lap(PurePursuit(), "oval", laps=1).e_y).max():.2f} m off the line')
    0.11 m off the line
    """

    gains: Mapping[str, Gain] = {
        'look_ahead': Gain(2.0, 'm', 'distance of the point at a standstill', 20.0, (0.1, 100.0)),
        'look_ahead_time': Gain(0.2, 's', 'more distance per speed', 3.0, (0.0, 10.0)),
    }
    law_gains = PursuitGains(nan, nan, nan, nan)  #: the present ones, as `pure_pursuit` takes them
    look_ahead = OfRecord()
    look_ahead_time = OfRecord()
    l_f = OfRecord()
    l_r = OfRecord()

    def steer_calculate(
        self, e_y: float, e_psi: float, speed: float, curvature: Curvature
    ) -> float:
        """Return the front angle [rad] for errors in metres and radians, and a speed in m/s."""
        step = pursuit_step(self.law_gains, speed)
        curvatures = tuple([curvature((k + 0.5) * step) for k in range(POINTS)])
        return self._sum(pure_pursuit(self.law_gains, e_y, e_psi, step, curvatures))


class Stanley(LaneLaw):
    """Steers the front wheels at the centre line (Hoffmann et al., ACC 2007).

    With the errors of the front axle, which on an arc are not those of the centre of mass::

        δ = -e_psi_front - atan(k e_y_front / (v_soft + v))

    Examples
    --------
    >>> from barc_sim import Stanley, lap
    >>> print(f'{abs(lap(Stanley(), "oval", laps=1).e_y).max():.2f} m off the line')
    0.15 m off the line
    """

    gains: Mapping[str, Gain] = {
        'k': Gain(2.0, '1/s', 'gain of the lateral error', 10.0),
        'v_soft': Gain(1.0, 'm/s', 'softens the law at low speed', 10.0, (1e-3, 1e3)),
    }
    law_gains = StanleyGains(nan, nan, nan)  #: the present ones, as `stanley` takes them
    k = OfRecord()
    v_soft = OfRecord()
    l_f = OfRecord()

    def steer_calculate(
        self, e_y: float, e_psi: float, speed: float, curvature: Curvature
    ) -> float:
        """Return the front angle [rad] for errors in metres and radians, and a speed in m/s."""
        return self._sum(stanley(self.law_gains, e_y, e_psi, speed, curvature(0.0)))


class LaneLQR(LaneLaw):
    """The linear-quadratic regulator of the errors about the steady turn, in closed form.

    For the errors e_y and e = e_psi - (e_psi of the steady turn), at a constant speed v::

        e_y' = v e + (v l_r / L) u        e' = (v / L) u        δ = steady turn + u

    Speed only changes the unit of time: the gains are the same at every speed, and the poles grow
    with it. For the weights q1 = `q_e_y`, q2 = `q_e_psi`, and 1 of u²::

        u = -k1 e_y - k2 e        k1 = √q1        k2 = √(q1 l_r² + q2 + 2 L √q1) - √q1 l_r

    The steady turn is that of the curvature `preview` seconds ahead, which compensates a delay.

    Examples
    --------
    >>> from barc_sim import LaneLQR, lap
    >>> print(f'{abs(lap(LaneLQR(), "oval", laps=1).e_y).max():.2f} m off the line')
    0.02 m off the line
    """

    gains: Mapping[str, Gain] = {
        'q_e_y': Gain(0.05, 'rad²/m²', 'weight of the lateral error', 1.0, (1e-6, 1e3)),
        'q_e_psi': Gain(0.2, '-', 'weight of the heading error', 10.0, (0.0, 1e3)),
        'preview': Gain(
            0.0, 's', 'delay of the steering, for which it looks ahead', 1.0, (0.0, 10.0)
        ),
    }
    law_gains = LaneLqrGains(nan, nan, nan, nan)  #: the present ones, as `lane_lqr` takes them
    q_e_y = OfRecord()
    q_e_psi = OfRecord()
    l_f = OfRecord()
    l_r = OfRecord()
    preview: float

    def feedback(self) -> tuple[float, float]:
        """Return k1 [rad/m] and k2."""
        return lane_feedback(self.law_gains)

    def steer_calculate(
        self, e_y: float, e_psi: float, speed: float, curvature: Curvature
    ) -> float:
        """Return the front angle [rad] for errors in metres and radians, and a speed in m/s."""
        here = curvature(0.0)
        ahead = curvature(self.preview * speed) if self.preview else here
        return self._sum(lane_lqr(self.law_gains, e_y, e_psi, here, ahead))


#: Which law steers, in `LaneGains`.
STRAIGHT_AHEAD = 0
REGULATOR = 1
STANLEY = 2
PURSUIT = 3


class LaneGains(NamedTuple):
    """One of the steering laws here; only the gains of this law have an effect."""

    kind: int  #: STRAIGHT_AHEAD, REGULATOR, STANLEY or PURSUIT
    lqr: LaneLqrGains
    preview: float  #: [s] of the regulator
    stanley: StanleyGains
    pursuit: PursuitGains


#: Of a car that drives straight ahead.
NO_LANE = LaneGains(
    STRAIGHT_AHEAD, LaneLQR.law_gains, nan, Stanley.law_gains, PurePursuit.law_gains
)


def lane_gains(lane: SteeringLaw) -> LaneGains | None:
    """Return a steering law with its present gains, which are floats.

    None: it is neither a `LaneLQR` nor a `Stanley` nor a `PurePursuit`.
    """
    if type(lane) is LaneLQR:
        of_lqr = LaneLqrGains._make(map(float, lane.law_gains))
        return NO_LANE._replace(kind=REGULATOR, lqr=of_lqr, preview=float(lane.preview))
    if type(lane) is Stanley:
        of_stanley = StanleyGains._make(map(float, lane.law_gains))
        return NO_LANE._replace(kind=STANLEY, stanley=of_stanley)
    if type(lane) is PurePursuit:
        of_pursuit = PursuitGains._make(map(float, lane.law_gains))
        return NO_LANE._replace(kind=PURSUIT, pursuit=of_pursuit)
    return None


@law
def with_lane_gains(gains: LaneGains, values: Column) -> LaneGains:
    """Return a steering law with other gains, which are in the order of its class's `gains`."""
    of_lqr = gains.lqr
    preview = gains.preview
    of_stanley = gains.stanley
    of_pursuit = gains.pursuit
    if gains.kind == REGULATOR:
        of_lqr = LaneLqrGains(values[0], values[1], of_lqr.l_f, of_lqr.l_r)
        preview = values[2]
    elif gains.kind == STANLEY:
        of_stanley = StanleyGains(values[0], values[1], of_stanley.l_f)
    elif gains.kind == PURSUIT:
        of_pursuit = PursuitGains(values[0], values[1], of_pursuit.l_f, of_pursuit.l_r)
    return LaneGains(gains.kind, of_lqr, preview, of_stanley, of_pursuit)


@law
def steer(
    gains: LaneGains, line: CentreLine, place: Frenet, segment: int, speed: float, room: Column
) -> float:
    """Return the front angle [rad] of a steering law within `STEERING_LIMIT`.

    The car is at `place`, on this segment of the centre line or not far from it, at a measured
    speed [m/s]. `room` is for `POINTS` numbers, which the law overwrites.
    """
    angle = 0.0
    if gains.kind == REGULATOR:
        here = curvature_at(line, place.s, segment)
        ahead = here
        if gains.preview:
            ahead = curvature_at(line, place.s + gains.preview * speed, segment)
        angle = steering_angle(lane_lqr(gains.lqr, place.e_y, place.e_psi, here, ahead))
    elif gains.kind == STANLEY:
        here = curvature_at(line, place.s, segment)
        angle = steering_angle(stanley(gains.stanley, place.e_y, place.e_psi, speed, here))
    elif gains.kind == PURSUIT:
        step = pursuit_step(gains.pursuit, speed)
        for k in range(POINTS):
            room[k] = curvature_at(line, place.s + (k + 0.5) * step, segment)
        angle = steering_angle(pure_pursuit(gains.pursuit, place.e_y, place.e_psi, step, room))
    angle, _ = limited_output(angle, -STEERING_LIMIT, STEERING_LIMIT)
    return angle


class LaneAdapter(Adapter):
    """A `SteeringLaw` around an object of the user's."""

    acceleration: float | None = None
    prediction: Any = None

    def steer_calculate(
        self, e_y: float, e_psi: float, speed: float, curvature: Curvature
    ) -> float:
        """Return the front angle [rad] for errors in metres and radians, and a speed in m/s."""
        angle: float = self._call('steer_calculate', e_y, e_psi, speed, curvature)
        return angle


class _PlanAdapter(LaneAdapter):
    """One whose object may have an acceleration and a prediction, as `SpeedMPC` has them."""

    def reset(self) -> None:
        """Begin with a fresh object."""
        super().reset()
        self._read_plan()

    def steer_calculate(
        self, e_y: float, e_psi: float, speed: float, curvature: Curvature
    ) -> float:
        """Return the front angle [rad], and take the rest of the plan."""
        angle = super().steer_calculate(e_y, e_psi, speed, curvature)
        self._read_plan()
        return angle

    def _read_plan(self) -> None:
        self.acceleration = getattr(self._object, 'acceleration', None)
        self.prediction = getattr(self._object, 'prediction', None)


def check_steering_law(lane: object) -> None:
    """Raise UserError if `lane` is no object with `steer_calculate`."""
    if isinstance(lane, type) or not callable(getattr(lane, 'steer_calculate', None)):
        raise UserError(
            f'lane={lane!r} must be an object with a method steer_calculate(e_y, e_psi, speed, '
            'curvature), such as LaneLQR()'
        )


def as_steering_law(lane: Any) -> SteeringLaw:  # noqa: ANN401 (any object of the user's)
    """Return `lane` itself if it is one of the laws here, an adapter around it otherwise.

    Gains and terms are those that the object declares. It plans the speed if it has an attribute
    `acceleration` [m/s²]. Without a `reset` of its own, a copy of it begins each run.

    Raises
    ------
    UserError
        if it is not an object with `steer_calculate`.
    """
    check_steering_law(lane)
    if isinstance(lane, (LaneLaw, LaneAdapter)):
        return lane
    has_reset = callable(getattr(lane, 'reset', None))

    def new(**values: float) -> Any:  # noqa: ANN401 (as above)
        fresh = lane if has_reset else deepcopy(lane)
        for name, value in values.items():
            setattr(fresh, name, value)
        if has_reset:
            fresh.reset()
        return fresh

    gains: Mapping[str, Gain] = getattr(lane, 'gains', {})
    values = {name: getattr(lane, name) for name in gains}
    declared = dict.fromkeys(getattr(lane, 'terms', ()), '')
    return _PlanAdapter(new, gains, values, {**LaneLaw.terms, **declared})


class ProfileColumns(NamedTuple):
    """The segments of a speed profile, in columns."""

    lengths: Column  #: [m]
    limits: Column  #: [m²/s²] squares of the maximum speeds
    squares: Column  #: [m²/s²] of the speeds where segments begin, and at the end of an open track
    along: float  #: [m/s²] longitudinal acceleration, either way


@law
def profile_speed(columns: ProfileColumns, segment: int, ahead: float) -> float:
    """Return the speed [m/s] of a profile, `ahead` [m] of the start of a segment."""
    following = (segment + 1) % len(columns.squares)
    left = columns.lengths[segment] - ahead
    by_begin = columns.squares[segment] + 2.0 * columns.along * ahead
    by_end = columns.squares[following] + 2.0 * columns.along * left
    return sqrt(max(min(columns.limits[segment], by_begin, by_end), 0.0))


@dataclass(frozen=True)
class SpeedProfile:
    """The speed [m/s] over a track, whose square is linear over s, or constant, on each segment."""

    track: Track
    columns: ProfileColumns

    def __call__(self, t: float, s: float) -> float:  # noqa: ARG002 (a `Signal` has it)
        """Return the speed [m/s] at `s` [m]; the time does not matter."""
        segment, ahead = self.track.segment(s)
        return profile_speed(self.columns, segment, ahead)


def speed_profile(track: Track, maximum: float, across: float, along: float) -> SpeedProfile:
    """Return the fastest speed [m/s] over a track, as a function of time, and of s [m].

    On each segment v² is linear over s, or constant: the function is exact.

    Parameters
    ----------
    track
        The track.
    maximum
        [m/s] maximum speed.
    across
        [m/s²] maximum lateral acceleration.
    along
        [m/s²] maximum longitudinal acceleration, and deceleration.

    Returns
    -------
    SpeedProfile
        The speed [m/s] as a function of time, which does not matter, and of s [m].

    Raises
    ------
    UserError
        if a limit is not a number above 0.

    Examples
    --------
    >>> from barc_sim.vehicle.track import Track
    >>> profile = speed_profile(Track.named('oval'), maximum=12.0, across=3.2, along=2.0)
    >>> print(f'{profile(0.0, 0.0):.2f} {profile(0.0, 25.0):.2f} {profile(0.0, 60.0):.2f} m/s')
    8.00 12.00 8.00 m/s
    """
    for name, limit in (('maximum', maximum), ('across', across), ('along', along)):
        if not 0.0 < limit < inf:
            raise UserError(f'{name} {limit!r} must be a number above 0')

    # Squares of speeds [m²/s²]: the limit on each segment, and where it begins and ends.
    limits = [min(maximum**2, across / abs(k) if k else inf) for k in track.curvatures]
    around = [limits[-1], *limits] if track.is_closed else [limits[0], *limits, limits[-1]]
    squares = [*map(min, around, around[1:])]

    # Over each segment the square can change by so much.
    gains = [2.0 * along * length for length in track.lengths]
    segments = [(i, (i + 1) % len(squares), gain) for i, gain in enumerate(gains)]
    for _ in range(2):  # a lap begins as fast as it ends
        for begin, end, gain in segments:
            squares[end] = min(squares[end], squares[begin] + gain)
        for begin, end, gain in reversed(segments):
            squares[begin] = min(squares[begin], squares[end] + gain)

    columns = ProfileColumns(track.lengths, tuple(limits), tuple(squares), along)
    return SpeedProfile(track, columns)
