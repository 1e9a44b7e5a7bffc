"""The track: straights and arcs end to end, with exact conversions between track and map.

`Track.place` converts from the frame of the track (s along the centre line, e_y to its left, e_psi
from its heading) to the map, and `Track.frenet` back. With (a, b) the position in the frame of a
segment's start, ahead and to the left, and κ its curvature::

    e_y = (2 b - κ (a² + b²)) / (1 + √((κ a)² + (1 - κ b)²))      s = atan2(κ a, 1 - κ b) / κ

These hold for a straight, too, where s = a, and lose no digits for a small κ.
"""

from __future__ import annotations

from bisect import bisect_right
from cmath import phase
from contextlib import contextmanager
from dataclasses import dataclass, field
from math import atan2, ceil, cos, floor, hypot, inf, isfinite, pi, sin, sqrt
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

from barc_sim.errors import UserError
from barc_sim.vehicle.law import law
from barc_sim.vehicle.road import RowError, read_named, stretch_at

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator
    from os import PathLike

    import numpy as np
    from numpy.typing import NDArray

    from barc_sim.vehicle.road import Places, Table

    Floats = NDArray[np.float64]
    Numbers = Any  #: one number, or an array of many

WIDTH = 6.0  #: [m]
_TURN = 2.0 * pi
_TOLERANCE = 0.05  #: [m] A fitted arc passes the points of a file within this.
_MIN_POINTS = 3  #: of a file with a centre line
_MAX_POINTS = 10_000
_FOLDING = 1.9  #: width over radius; at 2 the inner edge of a bend is a point
_TOO_FAR = 1e100  #: [m] between two points, which squared is infinite
_EQUALLY_NEAR = 1e-9  #: [m] difference of two distances
_SAME_WAY = 0.7  #: cosine of the angle between two laps at one place
_SPACING = 0.5  #: [m] between two places that are drawn
_MAX_SAMPLES = 5000  #: places that are drawn
_SEGMENTS = 'length_m,radius_m'  #: header of a file with segments
_CENTRE_LINE = 'x_m,y_m,w_tr_right_m,w_tr_left_m'  #: header of a file with points
RACING_LINE = f'{_CENTRE_LINE},speed_mps'


class Pose(NamedTuple):
    """A pose on the map; the fields can be arrays of many poses."""

    x: float  #: [m]
    y: float  #: [m]
    psi: float  #: [rad] heading, counter-clockwise from x


_ORIGIN = Pose(0.0, 0.0, 0.0)


class Frenet(NamedTuple):
    """A pose on a track; the fields can be arrays of many poses."""

    s: float  #: [m] along the centre line; it grows over the laps
    e_y: float  #: [m] to the left of the centre line
    e_psi: float  #: [rad] heading minus the heading of the centre line, from -π to π
    curvature: float  #: [1/m] of the centre line there, positive to the left


class _Course(Protocol):
    """A record of a course."""

    @property
    def length(self) -> float:
        """Its length [m]."""

    @property
    def is_closed(self) -> bool:
        """Whether it ends where it begins."""


class Segment(NamedTuple):
    """A segment of a centre line, with the frame of its start."""

    start: float  #: [m] along the track
    end: float  #: [m]
    x: float  #: [m] of its start
    y: float  #: [m]
    psi: float  #: [rad] its heading there, with cosine and sine
    cosine: float
    sine: float
    curvature: float  #: [1/m]
    half: float  #: [rad] of its turn


class CentreLine(NamedTuple):
    """The centre line of a track, as the laws take it."""

    starts: Any  #: [m] of the segments: a tuple of numbers; in compiled code, an array
    segments: Any  #: a tuple of `Segment`; in compiled code, an array of records with its fields
    length: float  #: [m]
    is_closed: bool


@dataclass(frozen=True)
class Track:
    """Segments of constant curvature from `start` on; a closed track ends where it begins.

    Parameters
    ----------
    lengths
        [m] length of each segment.
    curvatures
        [1/m] curvature of each segment, positive to the left, 0 for a straight.
    width
        [m] from edge to edge.
    name
        Its name in figures and bags.
    start
        Pose of its start on the map.
    deviation
        [m] maximum distance of a file's points from the centre line.

    Raises
    ------
    UserError
        if a segment or the width is impossible.

    Examples
    --------
    >>> track = Track.named('oval')
    >>> pose = track.place(60.0, 1.5, 0.1)
    >>> print('{:.2f} {:.2f} {:.2f} {:.2f}'.format(*track.frenet(*pose)))
    60.00 1.50 0.10 0.05
    """

    lengths: tuple[float, ...]
    curvatures: tuple[float, ...]
    width: float = WIDTH  #: [m] from edge to edge
    name: str = 'track'
    start: Pose = _ORIGIN
    deviation: float = 0.0  #: [m] maximum distance of the file's points from the centre line
    starts: tuple[float, ...] = field(init=False, repr=False, compare=False)  #: [m]; the end, too
    is_closed: bool = field(init=False, repr=False, compare=False)
    line: CentreLine = field(init=False, repr=False, compare=False)  #: for the laws

    def __post_init__(self) -> None:
        """Raise UserError if a segment or the width is impossible."""
        for name in ('lengths', 'curvatures'):  # arrays, too
            object.__setattr__(self, name, tuple(map(float, getattr(self, name))))
        if not self.lengths or len(self.lengths) != len(self.curvatures):
            raise UserError(
                f'{len(self.lengths)} lengths and {len(self.curvatures)} curvatures: expected the '
                'same number of both, at least one'
            )

        if not 0.0 < self.width < 1e3:  # noqa: PLR2004
            raise UserError(f'width {self.width!r} must be a number of metres from 0 to 1000')

        first = Pose(*self.start)
        pose = first
        end = 0.0
        segments = list[Segment]()
        for i, (length, curvature) in enumerate(zip(self.lengths, self.curvatures, strict=True)):
            self._check_segment(i, length, curvature)
            segment = Segment(
                start=end,
                end=end + length,
                x=pose.x,
                y=pose.y,
                psi=pose.psi,
                cosine=cos(pose.psi),
                sine=sin(pose.psi),
                curvature=curvature,
                half=0.5 * curvature * length,
            )
            segments.append(segment)
            end = segment.end
            pose = placed(segment, length, 0.0, 0.0)

        gap = hypot(pose.x - first.x, pose.y - first.y)
        turn = abs(wrapped(pose.psi - first.psi))
        is_closed = gap + turn * end < 1e-6 * end
        starts = tuple(segment.start for segment in segments)
        line = CentreLine(starts, tuple(segments), end, is_closed)
        object.__setattr__(self, 'starts', (*starts, end))
        object.__setattr__(self, 'is_closed', is_closed)
        object.__setattr__(self, 'line', line)

    def _check_segment(self, i: int, length: float, curvature: float) -> None:
        """Raise RowError if segment `i` is impossible."""
        if not (isfinite(length) and length > 0.0 and isfinite(curvature)):
            raise RowError(
                i,
                f'a segment has length {length!r} m and curvature {curvature!r} 1/m: expected '
                'a length above 0, and a finite curvature, 0 for a straight',
            )
        if abs(curvature) * length > _TURN + 1e-9:
            raise RowError(
                i,
                f'an arc of {length:g} m with radius {1.0 / curvature:g} m is more than a '
                'whole turn: make it two arcs',
            )
        if abs(curvature) * self.width >= 2.0:  # noqa: PLR2004
            raise RowError(
                i,
                f'radius {1.0 / curvature:g} m must be above half of the width, {self.width:g} '
                'm: make the arc wider, or the track narrower',
            )

    @classmethod
    def named(cls, name: str) -> Track:
        """Return the track called `L`, `oval`, `circle` or `figure-eight`, or read a CSV file.

        The file has the columns `length_m,radius_m` (radius 0: a straight; positive: to the left),
        or those of the public racetrack database, `x_m,y_m,w_tr_right_m,w_tr_left_m`, to which arcs
        are fitted: within 5 cm, or through each point if there is a column `speed_mps`, as in a
        racing line's file. Such a track is closed, and as wide as its narrowest place; a bend whose
        inner edge would fold counts as narrow. Points beyond the first lap are left out.

        Raises
        ------
        UserError
            if there is no such track, or the file does not describe one.
        """
        if name in TRACKS:
            return cls.of_rows(TRACKS[name], name)

        def read(table: Table) -> Track:
            if table.header == _SEGMENTS:
                return cls.of_rows(zip(*table.columns, strict=True), name)

            x, y = table.columns[:2]
            to_edges = table.columns[2:4]
            if not _MIN_POINTS <= len(x) <= _MAX_POINTS:
                raise ValueError(f'{len(x)} points, not {_MIN_POINTS} to {_MAX_POINTS}')
            for i, distances in enumerate(zip(*to_edges, strict=True)):
                nearer = min(distances)
                if nearer <= 0.0:
                    raise RowError(i, f'the edge is {nearer:g} m away: expected more than 0')

            width = 2.0 * min(map(min, to_edges))
            n = _points_of_a_lap([*map(complex, x, y)], 0.5 * width)
            tolerance = 0.0 if table.header == RACING_LINE else _TOLERANCE
            return cls.through(x[:n], y[:n], width, name, tolerance, narrowing=True)

        return read_named('track', name, TRACKS, read, _SEGMENTS, _CENTRE_LINE, RACING_LINE)

    @classmethod
    def through(
        cls,
        x: Iterable[float],
        y: Iterable[float],
        width: float = WIDTH,
        name: str = 'track',
        tolerance: float = 0.0,
        *,
        narrowing: bool = False,
    ) -> Track:
        """Return the closed track of arcs along these points [m], which are in order.

        It has the fewest arcs that stay within `tolerance` [m] of the points; 0: through each. With
        `narrowing`, it is narrower than `width` where the inner edge of a bend would fold: up to a
        third of it.
        """
        points = [*map(complex, x, y)]
        start, arcs, deviation, at = _fit(points, tolerance)
        lengths, curvatures = zip(*arcs, strict=True)

        sharpest = max(map(abs, curvatures))
        if narrowing and sharpest * width > _FOLDING:
            if sharpest * width > 3.0 * _FOLDING:
                i = [*map(abs, curvatures)].index(sharpest)
                raise RowError(
                    at[i],
                    f'the line bends near here with a radius of {1.0 / sharpest:.3g} m, and its '
                    f'edges are {0.5 * width:g} m away: leave the point out, or bend it less',
                )
            width = _FOLDING / sharpest
        return cls(lengths, curvatures, width, name, start, deviation)

    @classmethod
    def of_rows(cls, rows: Iterable[tuple[float, float]], name: str) -> Track:
        """Return the track of these lengths and radii [m], as a file has them."""
        lengths, radii = zip(*rows, strict=True)
        return cls(lengths, tuple(radius and 1.0 / radius for radius in radii), name=name)

    @classmethod
    def of(cls, track: Track | str | PathLike[str]) -> Track:
        """Return `track` itself, or the one of that name."""
        return track if isinstance(track, Track) else cls.named(str(track))

    def check_laps(self, laps: int) -> None:
        """Raise UserError if a track that is not closed has other than one lap; 0: no end."""
        if laps != 1 and not self.is_closed:
            raise UserError(f'track {self.name!r} is not closed: expected laps 1, not {laps}')

    @property
    def length(self) -> float:
        """The length of the centre line [m], which is a lap of a closed track."""
        return self.starts[-1]

    def samples(self) -> Floats:
        """Return positions [m] at which to draw the track, with each segment's ends."""
        import numpy as np  # noqa: PLC0415 (a track alone does not need it)

        n = min(ceil(self.length / _SPACING), _MAX_SAMPLES)
        return np.union1d(np.linspace(0.0, self.length, n + 1), self.starts)

    def lines(self) -> tuple[Pose, Pose, Pose]:
        """Return the left edge, the right edge and the centre line, each at all `samples`."""
        s = self.samples()
        half = 0.5 * self.width
        return self.place(s, half), self.place(s, -half), self.place(s)

    def curvature(self, s: Places) -> Places:
        """Return the curvature [1/m] at `s` metres; an array, of an array."""
        if isinstance(s, (float, int)):
            return self.curvatures[self.segment(s)[0]]
        import numpy as np  # noqa: PLC0415 (a track alone does not need it)

        curvatures: Floats = np.array(self.curvatures)[self._in_segments(s)[0]]
        return curvatures

    def place(self, s: Numbers, e_y: Numbers = 0.0, e_psi: Numbers = 0.0) -> Pose:
        """Return the pose on the map of a pose on the track; arrays, of arrays."""
        if all(isinstance(each, (float, int)) for each in (s, e_y, e_psi)):
            i, ahead = self.segment(s)
            return placed(self.line.segments[i], ahead, e_y, e_psi)
        return self._place_many(s, e_y, e_psi)

    def frenet(self, x: Numbers, y: Numbers, psi: Numbers, near: Numbers = None) -> Frenet:
        """Return the pose on the track of a pose on the map; arrays, of arrays.

        `near` [m] is the position of the car at most a few metres ago. The search starts there,
        segment by segment, so that it finds the right part at a crossing or beside another part,
        and s grows over the finish line. Without it the nearest point counts.
        """
        if isinstance(x, (float, int)):
            if near is None:
                near = nearest(self.line, x, y)
            return project(self.line, x, y, psi, near, self.segment(near)[0])[0]
        import numpy as np  # noqa: PLC0415 (a track alone does not need it)

        columns = [np.asarray(each, np.float64) for each in (x, y, psi)]
        if near is not None:
            columns.append(np.asarray(near, np.float64))
        rows = zip(*(each.tolist() for each in np.broadcast_arrays(*columns)), strict=True)
        places = np.array([self.frenet(*row) for row in rows], np.float64)
        return Frenet(*places.reshape(-1, len(Frenet._fields)).T)

    def segment(self, s: float) -> tuple[int, float]:
        """Return the number of the segment at `s`, and the distance from its start [m]."""
        starts = self.starts
        s = in_lap(self.line, s)
        i = bisect_right(starts, s, 1, len(starts) - 1) - 1
        return i, s - starts[i]

    def _place_many(self, s: Numbers, e_y: Numbers, e_psi: Numbers) -> Pose:
        """Return what `placed` does, of many poses."""
        import numpy as np  # noqa: PLC0415 (a track alone does not need it)

        i, s_in_lap = self._in_segments(np.asarray(s, np.float64))
        there = Segment(*np.array(self.line.segments)[i].T)
        ahead = s_in_lap - there.start
        half = 0.5 * there.curvature * ahead
        chord = ahead * np.sinc(half / pi)
        along = there.psi + half
        psi = along + half

        x = there.x + chord * np.cos(along) - e_y * np.sin(psi)
        y = there.y + chord * np.sin(along) + e_y * np.cos(psi)
        poses: Any = np.broadcast_arrays(x, y, psi + e_psi)
        return Pose(*poses)

    def _in_segments(self, s: Floats) -> tuple[NDArray[np.intp], Floats]:
        import numpy as np  # noqa: PLC0415 (a track alone does not need it)

        s = s % self.length if self.is_closed else s
        return np.array(self.line.starts)[1:].searchsorted(s, side='right'), s


@law
def wrapped(angle: float) -> float:
    """Return an angle [rad] without its whole turns, from -π to π.

    It is `math.remainder`, which Numba does not have: `%` of positive numbers is exact, and so is
    the difference of two numbers of which one is at most twice as large as the other (Sterbenz,
    "Floating-Point Computation", 1974). Only odd multiples of π keep their sign here.
    """
    if -pi <= angle <= pi:
        return angle
    rest = abs(angle)
    if rest >= _TURN:
        rest = rest - _TURN if rest < 2.0 * _TURN else rest % _TURN
    if rest > pi:
        rest -= _TURN
    return rest if angle > 0.0 else -rest


@law
def in_lap(line: _Course, s: float) -> float:
    """Return the position [m] on the lap of a position that grows over the laps."""
    if line.is_closed and not 0.0 <= s < line.length:
        return s - floor(s / line.length) * line.length
    return s


@law
def segment_at(line: CentreLine, s: float) -> int:
    """Return the number of the segment at `s` [m]."""
    return stretch_at(line.starts, in_lap(line, s), 0)


@law
def project(
    line: CentreLine, x: float, y: float, psi: float, near: float, i: int
) -> tuple[Frenet, int]:
    """Return the pose on the track of a pose on the map, and the number of its segment.

    The search starts where the car was, at `near` [m] on segment `i`.
    """
    count = len(line.segments)
    searched = 0
    while True:
        segment = line.segments[i]
        s, e_y = beside_segment(segment, x, y)
        searched += 1

        is_after = s >= segment.end
        if not (is_after or s < segment.start) or searched == count:
            break

        following = i + 1 if is_after else i - 1
        if not (line.is_closed or 0 <= following < count):
            break
        i = following % count

    e_psi = wrapped(psi - segment.psi - segment.curvature * (s - segment.start))
    if line.is_closed:
        s += line.length * round((near - s) / line.length)
    return Frenet(s, e_y, e_psi, segment.curvature), i


@law
def locate(line: CentreLine, width: float, pose: Pose, near: float, i: int) -> tuple[Frenet, int]:
    """Return the pose on the track of a measured pose, and the number of its segment.

    The car was at `near` [m], on segment `i` or not far from it. Where the pose is farther from the
    centre line than the `width` [m] of the track, the car was put somewhere else: then the nearest
    point counts.
    """
    i = stretch_at(line.starts, in_lap(line, near), i)
    place, segment = project(line, pose.x, pose.y, pose.psi, near, i)
    if abs(place.e_y) > width:
        near = nearest(line, pose.x, pose.y)
        place, segment = project(line, pose.x, pose.y, pose.psi, near, segment_at(line, near))
    return place, segment


@law
def curvature_at(line: CentreLine, s: float, i: int) -> float:
    """Return the curvature [1/m] at `s` [m], on segment `i` or not far from it."""
    curvature: float = line.segments[stretch_at(line.starts, in_lap(line, s), i)].curvature
    return curvature


@law
def is_off_track(e_y: float, width: float) -> bool:
    """Return whether a car is beyond the edge of a track."""
    return abs(e_y) > 0.5 * width


@law
def beside_segment(segment: Segment, x: float, y: float) -> tuple[float, float]:
    """Return s and e_y [m] of a point on the map, beside a segment or its continuation."""
    dx = x - segment.x
    dy = y - segment.y
    ahead = dx * segment.cosine + dy * segment.sine
    across = dy * segment.cosine - dx * segment.sine
    if not segment.curvature:
        return segment.start + ahead, across
    e_y, turned = beside_arc(segment.curvature, ahead, across)
    ahead = (segment.half + wrapped(turned - segment.half)) / segment.curvature
    return segment.start + ahead, e_y


@law
def nearest(line: CentreLine, x: float, y: float) -> float:
    """Return s [m] of the point of the centre line that is nearest to a point on the map.

    If several points are equally near except for rounding, it is the first of them.
    """
    near = 0.0
    minimum = inf
    for segment in line.segments:
        s, _ = beside_segment(segment, x, y)
        s = min(max(s, segment.start), segment.end)
        there = placed(segment, s - segment.start, 0.0, 0.0)
        distance = sqrt((x - there.x) * (x - there.x) + (y - there.y) * (y - there.y))
        if distance < minimum - _EQUALLY_NEAR:
            near = s
            minimum = distance
    return near


@law
def placed(segment: Segment, ahead: float, e_y: float, e_psi: float) -> Pose:
    """Return the pose on the map of a pose on the track, `ahead` [m] from a segment's start."""
    half = 0.5 * segment.curvature * ahead
    chord = ahead * (sin(half) / half if half else 1.0)
    along = segment.psi + half
    psi = along + half
    return Pose(
        segment.x + chord * cos(along) - e_y * sin(psi),
        segment.y + chord * sin(along) + e_y * cos(psi),
        psi + e_psi,
    )


@law
def beside_arc(curvature: float, a: float, b: float) -> tuple[float, float]:
    """Return e_y [m] of a point `a` m ahead of an arc's start and `b` m to its left.

    The second value is the turn [rad] of the arc up to the point beside it, from -π to π.
    """
    across = curvature * a
    along = 1.0 - curvature * b
    distance = sqrt(across * across + along * along)
    e_y = (2.0 * b - curvature * (a * a + b * b)) / (1.0 + distance)
    return e_y, atan2(across, along)


def _beside_arcs(curvature: Numbers, a: Floats, b: Floats) -> tuple[Floats, Floats]:
    """Return what `beside_arc` does, of many points."""
    import numpy as np  # noqa: PLC0415 (a track alone does not need it)

    across = curvature * a
    along = 1.0 - curvature * b
    distance = np.sqrt(across * across + along * along)
    e_y = (2.0 * b - curvature * (a * a + b * b)) / (1.0 + distance)
    return e_y, np.arctan2(across, along)


# A centre line of points: between two of them a biarc, two arcs that meet with one heading (Bolton,
# "Biarc curves", Computer-Aided Design 7, 1975). As few of the points as possible are such ends.


def _points_of_a_lap(points: list[complex], reach: float) -> int:
    """Return how many of the points of a line are its first lap.

    A lap ends where the line passes its first point again, within `reach` [m] and in the same
    direction, if all later points are so near to the lap. The first point at the end is left out.
    """
    import numpy as np  # noqa: PLC0415 (a track alone does not need it)

    z = np.array(points)
    steps = np.diff(z)
    lengths = np.abs(steps)
    if not ((lengths > 0.0) & (lengths < _TOO_FAR)).all():
        return _without_the_first(points, len(points))

    from_start = np.abs(z - z[0])
    away = np.flatnonzero(from_start > 2.0 * reach)
    if not away.size:
        return _without_the_first(points, len(points))

    # Where the line passes the first point: between which two points, and how far from it.
    directions = steps / lengths
    ahead = np.clip(((z[0] - z[:-1]) * directions.conj()).real, 0.0, lengths)
    distance = np.abs(z[:-1] + ahead * directions - z[0])
    along = (directions * directions[0].conj()).real
    passes = np.flatnonzero((distance < reach) & (along > _SAME_WAY))
    passes = passes[passes > away[0]]
    if not passes.size:
        return _without_the_first(points, len(points))

    # The steps of the first pass follow one another: its nearest one ends the lap.
    gaps = np.flatnonzero(np.diff(passes) > 1)
    first_pass = passes[: gaps[0] + 1] if gaps.size else passes
    last = int(first_pass[np.argmin(distance[first_pass])])

    # The point behind this step is of the lap, too, if the line passes the first one beyond it.
    n = last + 2 if ahead[last] == lengths[last] else last + 1
    for late in z[n:]:
        if np.abs(z[:n] - late).min() > reach + lengths.max():
            return _without_the_first(points, len(points))
    return _without_the_first(points, n)


def _without_the_first(points: list[complex], n: int) -> int:
    """Return the number of points before the last of `n` if that is the first once more."""
    spacing = abs(points[1] - points[0])
    while n > _MIN_POINTS and abs(points[n - 1] - points[0]) < max(_TOLERANCE, 0.25 * spacing):
        n -= 1
    return n


def _fit(
    points: list[complex], tolerance: float
) -> tuple[Pose, list[tuple[float, float]], float, list[int]]:
    """Return a closed line along points: its start, and its arcs.

    The other values are the maximum distance of a point from them [m], and the point at which each
    arc, or the one before it, begins. RowError: a point is the one before it, or the line turns
    back at it.
    """
    import numpy as np  # noqa: PLC0415 (a track alone does not need it)

    before = [points[-1], *points[:-1]]
    after = [*points[1:], points[0]]
    nodes = []
    for i, (a, p, b) in enumerate(zip(before, points, after, strict=True)):
        with _named_point(i):
            # The heading of the circle through a point and its neighbours.
            heading = (p - a) / abs(p - a) ** 2 + (b - p) / abs(b - p) ** 2
            nodes.append((p, heading / abs(heading)))
    start = Pose(points[0].real, points[0].imag, phase(nodes[0][1]))
    nodes.append(nodes[0])

    places = np.array(points)
    arcs = list[tuple[float, float]]()
    at = list[int]()
    maximum = 0.0
    i = 0
    while i < len(points):
        p, t = nodes[i]
        with _named_point(i):
            for j in range(i + 1, len(nodes) if tolerance else i + 2):
                q, u = nodes[j]
                if q == p:
                    break
                joint, heading = _joint(p, t, q, u)
                to_joint = _arc(joint - p, t)
                from_joint = _arc(q - joint, heading)

                # The points between, in the frame of the joint.
                z = (places[i + 1 : j] - joint) / heading
                bend = np.where(z.real < 0.0, to_joint[1], from_joint[1])
                e_y, _ = _beside_arcs(bend, z.real, z.imag)
                off = float(np.abs(e_y).max(initial=0.0))
                if not off <= tolerance:
                    break
                # The first pair of arcs has no points between its ends, so that there is one.
                best = [to_joint, from_joint]
                deviation = off
                last = j
        arcs += best
        at += [i, i]
        maximum = max(maximum, deviation)
        i = last
    return start, arcs, maximum, at


@contextmanager
def _named_point(index: int) -> Iterator[None]:
    """Raise RowError for this point where a number is divided by zero, or is too large."""
    try:
        yield
    except ArithmeticError:
        raise RowError(
            index,
            'this point is the same as its neighbour or too far from it, or the line turns back at '
            'it: leave it out',
        ) from None


def _joint(p: complex, t: complex, q: complex, u: complex) -> tuple[complex, complex]:
    """Return the joint, and its heading, of two arcs from `p` to `q` with headings `t` and `u`."""
    v = q - p
    w = t + u
    dot = (v * w.conjugate()).real
    bend = 2.0 * (1.0 - (t * u.conjugate()).real)
    chord = abs(v) ** 2
    # The distance from each end along its heading to the joint's tangent.
    d = chord / (dot + sqrt(dot * dot + bend * chord))
    joint = 0.5 * (p + d * t + q - d * u)
    return joint, (q - joint) ** 2 / (u * abs(q - joint) ** 2)


def _arc(chord: complex, tangent: complex) -> tuple[float, float]:
    """Return length and curvature of the arc over `chord` that begins along `tangent`."""
    half = phase(chord / tangent)
    length = abs(chord) * (half / sin(half) if half else 1.0)
    return length, 2.0 * half / length


def l_shape(
    radii: Iterable[float] = (10.2, 12.2, 11.5, 12.3), straight: float = 22.5
) -> tuple[tuple[float, float], ...]:
    """Return lengths and radii [m] of an L; by default ten times as large as BARC's own track.

    The radii are those of two corners and two U-turns; `straight` is the first straight's length.
    """
    first, second, upper, lower = radii
    short = 9.0
    link = 1.5
    side = 2.0 * upper + first + link - second
    back = 2.0 * lower - second + first + short - straight
    return (
        (straight, 0.0),
        (pi * upper, upper),
        (short, 0.0),
        (0.5 * pi * first, -first),
        (link, 0.0),
        (pi * lower, lower),
        (side, 0.0),
        (0.5 * pi * second, second),
        (back, 0.0),
    )


#: The tracks with a name: length and radius [m] of each segment; 0: a straight.
TRACKS = {
    'L': l_shape(),
    'oval': ((50.0, 0.0), (20.0 * pi, 20.0)) * 2,
    'circle': ((40.0 * pi, 20.0),),
    'figure-eight': ((40.0, 0.0), (30.0 * pi, 20.0), (40.0, 0.0), (30.0 * pi, -20.0)),
}
