"""The log of a run: its columns with unit, topic and field."""

from __future__ import annotations

from collections.abc import Mapping  # noqa: TC003 (get_type_hints reads it)
from dataclasses import dataclass, field, fields, replace
from functools import wraps
from types import MappingProxyType
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, NamedTuple, TypeVar, get_type_hints

import numpy as np
from numpy.typing import NDArray

from barc_sim.cli.packages import extra
from barc_sim.control.lane import LANE, LaneLaw
from barc_sim.control.speed import PID
from barc_sim.interfaces.topics import (
    APPLIED_COMMAND,
    ECU,
    ENVIRONMENT,
    LANE_STATE,
    PID_STATE,
    STATE,
    STATE_ERROR,
    TRACK_STATE,
)
from barc_sim.vehicle.track import Track  # noqa: TC001 (as above)

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Sequence

    import pandas as pd
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure, SubFigure
    from typing_extensions import Self

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]


class Column(NamedTuple):
    """The declaration of a column: its unit and meaning, and where the bag has it."""

    unit: str
    meaning: str
    topic: str = ''  #: of the messages with it; empty if no message has it
    field: str = ''  #: of the message; empty if it has the column's name without the prefix


#: The prefix of a topic's fields in the names of columns.
_PREFIXES = {STATE_ERROR: 'e_', LANE_STATE: 'steer_'}


_Kind = TypeVar('_Kind', bound='type[Log]')


def _takes_own_terms(kind: _Kind) -> _Kind:
    """Make the constructor take `own_terms` by their names, too: `Log(**log.columns())`."""
    make: Any = kind.__init__
    names = {each.name for each in fields(kind)}

    @wraps(make)
    def init(self: Log, **columns: Any) -> None:  # noqa: ANN401 (any column)
        terms = {name: columns.pop(name) for name in [*columns] if name not in names}
        if terms:
            columns['own_terms'] = {**columns.get('own_terms', {}), **terms}
        make(self, **columns)

    kind.__init__ = init  # type: ignore[method-assign]
    return kind


@_takes_own_terms
@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Log:
    """The log of a run: a row per state `k`; every array has shape `(n,)`, SI units, radians.

    A number that the run did not have is NaN, such as a term without a controller, or a command
    that did not arrive. A flag cannot be NaN: it is False, such as `saturated` without a
    controller. The bag reader, the live page and `to_frame` derive from these declarations.

    Examples
    --------
    >>> from barc_sim import simulate
    >>> log = simulate()
    >>> print(len(log), f'{log.speed.max():.3f} m/s')
    1152 8.126 m/s
    """

    declared: ClassVar[Mapping[str, Column]]  #: its columns, by name

    t: Annotated[Floats, Column('s', 'time since the first state')]
    # As measured: true state plus measurement error.
    x: Annotated[Floats, Column('m', "position along the road's surface", STATE)]
    y: Annotated[Floats, Column('m', 'position to the left', STATE)]
    psi: Annotated[Floats, Column('rad', 'heading', STATE)]
    v_x: Annotated[Floats, Column('m/s', 'speed along the vehicle', STATE)]
    v_y: Annotated[Floats, Column('m/s', "speed to the vehicle's left", STATE)]
    psi_dot: Annotated[Floats, Column('rad/s', 'yaw rate', STATE)]
    # Measured minus true, in the vehicle's frame.
    e_s: Annotated[Floats, Column('m', 'longitudinal position error', STATE_ERROR)]
    e_ey: Annotated[Floats, Column('m', 'lateral position error', STATE_ERROR)]
    e_epsi: Annotated[Floats, Column('rad', 'heading error', STATE_ERROR)]
    e_v_x: Annotated[Floats, Column('m/s', 'longitudinal speed error', STATE_ERROR)]
    e_v_y: Annotated[Floats, Column('m/s', 'lateral speed error', STATE_ERROR)]
    e_psi_dot: Annotated[Floats, Column('rad/s', 'yaw rate error', STATE_ERROR)]
    # The command that the simulator applies from state k on: the answer to the state, or if that is
    # late, an earlier one. It is the input of the actuators, whose values are in no column.
    motor: Annotated[Floats, Column('m/s²', 'acceleration command', APPLIED_COMMAND)]
    servo: Annotated[Floats, Column('rad', 'steering angle command', APPLIED_COMMAND)]
    missed: Annotated[Flags, Column('', 'whether no command answered in time', APPLIED_COMMAND)]
    # The surroundings.
    theta_deg: Annotated[Floats, Column('deg', 'incline of the road', ENVIRONMENT, 'theta')]
    elevation: Annotated[Floats, Column('m', 'height of the road', ENVIRONMENT)]
    friction: Annotated[Floats, Column('N', 'friction', ENVIRONMENT)]
    drag: Annotated[Floats, Column('N', 'air drag', ENVIRONMENT)]
    gravity: Annotated[Floats, Column('N', 'gravity along the road', ENVIRONMENT)]
    # The controller.
    reference: Annotated[Floats, Column('m/s', 'speed to hold', PID_STATE)]
    proportional: Annotated[Floats, Column('m/s²', PID.terms['proportional'], PID_STATE)]
    integral: Annotated[Floats, Column('m/s²', PID.terms['integral'], PID_STATE)]
    derivative: Annotated[Floats, Column('m/s²', PID.terms['derivative'], PID_STATE)]
    saturated: Annotated[Flags, Column('', 'whether a limit cut the command', PID_STATE)]
    #: The terms of a controller other than a PID [m/s²], by name, each of shape `(n,)`; and the
    #: terms of a steering law that a `TrackLog` lacks, whose names begin with 'lane.'.
    own_terms: Mapping[str, Floats] = field(default_factory=dict)
    #: Parameters over time, each of shape `(n,)`, by node and name, such as 'controller.kp': those
    #: of a recorded run that are numbers and can be changed while it drives.
    parameters: Mapping[str, Floats] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Raise ValueError unless every array has one dimension and as many elements as `t`."""
        expected = (np.size(self.t),)
        for name, values in {**self.columns(), **self.parameters}.items():
            if np.shape(values) != expected:
                raise ValueError(f'{name} has shape {np.shape(values)}, expected {expected}')

    def __len__(self) -> int:
        """Return the number of states."""
        return len(self.t)

    def columns(self) -> dict[str, Floats | Flags]:
        """Return all arrays by name, those of `own_terms` last; `parameters` are apart."""
        return {name: getattr(self, name) for name in self.declared} | dict(self.own_terms)

    def map(self, function: Callable[[NDArray[Any]], NDArray[Any]]) -> Self:
        """Return a log of `function(column)` for each column, such as some of its rows."""
        columns = {name: function(getattr(self, name)) for name in self.declared}
        terms = {name: function(values) for name, values in self.own_terms.items()}
        parameters = {name: function(values) for name, values in self.parameters.items()}
        return replace(self, **columns, own_terms=terms, parameters=parameters)

    @property
    def terms(self) -> dict[str, Floats]:
        """Terms of the controller [m/s²] by name; without a controller, a PID's, unknown."""
        pid = {name: getattr(self, name) for name in PID.terms}
        recorded = {name: values for name, values in pid.items() if not np.isnan(values).all()}
        others = {name: each for name, each in self.own_terms.items() if not name.startswith(LANE)}
        return (recorded | others) if others else pid

    @property
    def speed(self) -> Floats:
        """True speed along the vehicle's axis [m/s], shape `(n,)`."""
        return self.v_x - self.e_v_x

    @property
    def true_pose(self) -> tuple[Floats, Floats, Floats]:
        """True position [m] and heading [rad], as x, y and psi, shape `(n,)` each.

        `e_s` and `e_ey` are in the frame of the true heading.
        """
        psi = self.psi - self.e_epsi
        x = self.x - (self.e_s * np.cos(psi) - self.e_ey * np.sin(psi))
        return x, self.y - (self.e_s * np.sin(psi) + self.e_ey * np.cos(psi)), psi

    @property
    def distance(self) -> Floats:
        """True position along the road's surface [m], shape `(n,)`."""
        return self.true_pose[0]

    @property
    def across(self) -> Floats:
        """True position to the left of the road's axis [m], shape `(n,)`."""
        return self.true_pose[1]

    @property
    def speed_error(self) -> Floats:
        """Reference minus true speed [m/s], shape `(n,)`."""
        return self.reference - self.speed

    def to_frame(self) -> pd.DataFrame:
        """Return a DataFrame of all columns and parameters; `attrs['units']` has units by name.

        Raises
        ------
        UserError
            if pandas is not installed.
        """
        frame: pd.DataFrame = extra('pandas', 'to_frame', 'pandas').DataFrame(
            {**self.columns(), **self.parameters}
        )
        of_terms = {name: '' if name.startswith(LANE) else 'm/s²' for name in self.own_terms}
        units = {name: column.unit for name, column in self.declared.items()}
        frame.attrs['units'] = of_terms | units
        return frame

    def plot(
        self, *others: Log, labels: Sequence[str] = (), ax: Axes | None = None
    ) -> Figure | SubFigure:
        """Draw this run, and others in the same figure: `barc_sim.plot`."""
        import barc_sim  # noqa: PLC0415 (it imports this module)

        return barc_sim.plot(self, *others, labels=labels, ax=ax)

    def __eq__(self, other: object) -> bool:
        """Return whether both have the same columns with the same values, NaN for NaN.

        Parameters do not count: two runs are equal if the same happened in both.
        """
        if not isinstance(other, Log):
            return NotImplemented
        columns = self.columns()
        of_other = other.columns()
        return columns.keys() == of_other.keys() and all(
            np.array_equal(columns[name], of_other[name], equal_nan=True) for name in columns
        )

    __hash__ = None  # type: ignore[assignment]  # its arrays can be changed

    def __repr__(self) -> str:
        """Return the run in a line."""
        return f'<Log: {_in_words(self)}>'


@_takes_own_terms
@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class TrackLog(Log):
    """The log of a run on a track; its position on the track is the true one.

    Examples
    --------
    >>> from barc_sim import lap
    >>> log = lap(track='oval', speed=8.0, laps=2)
    >>> print(f'{log.best:.2f} s, at most {abs(log.e_y).max():.2f} m off the centre line')
    28.18 s, at most 0.02 m off the centre line
    """

    s: Annotated[Floats, Column('m', 'distance along the track, over all laps', TRACK_STATE)]
    e_y: Annotated[Floats, Column('m', 'distance to the left of the centre line', TRACK_STATE)]
    e_psi: Annotated[Floats, Column('rad', 'heading minus heading of the centre line', TRACK_STATE)]
    curvature: Annotated[Floats, Column('1/m', 'curvature of the centre line', TRACK_STATE)]
    width: Annotated[Floats, Column('m', 'width of the track there', TRACK_STATE)]
    lap: Annotated[Floats, Column('', 'number of the lap, from 0', TRACK_STATE)]
    lap_time: Annotated[Floats, Column('s', 'time since the lap began', TRACK_STATE)]
    # The lane controller.
    steer_feedforward: Annotated[Floats, Column('rad', LaneLaw.terms['feedforward'], LANE_STATE)]
    steer_of_e_y: Annotated[Floats, Column('rad', LaneLaw.terms['of_e_y'], LANE_STATE)]
    steer_of_e_psi: Annotated[Floats, Column('rad', LaneLaw.terms['of_e_psi'], LANE_STATE)]
    steer_saturated: Annotated[Flags, Column('', 'whether a limit cut the steering', LANE_STATE)]
    track: Track | None = None  #: None: unknown, as in a bag that another program recorded

    @property
    def distance(self) -> Floats:
        """True distance along the track [m], shape `(n,)`."""
        return self.s

    @property
    def across(self) -> Floats:
        """True distance to the left of the centre line [m], shape `(n,)`."""
        return self.e_y

    @property
    def lap_times(self) -> Floats:
        """Times of the finished laps [s]; one begins and ends between two states."""
        first = np.flatnonzero(~(np.diff(self.lap_time, prepend=np.inf) >= 0.0))  # a reset's, too
        times = np.diff((self.t - self.lap_time)[first])
        finished: Floats = times[np.diff(self.lap[first]) == 1.0]
        return finished

    @property
    def best(self) -> float:
        """The fastest lap [s] except the first, unless that is the only one; inf without a lap."""
        times = self.lap_times
        return float(np.min(times[1:] if len(times) > 1 else times, initial=np.inf))


def _declared(kind: type[Log]) -> Iterator[tuple[str, Column]]:
    for name, hint in get_type_hints(kind, include_extras=True).items():
        for column in getattr(hint, '__metadata__', ()):
            field = column.field or name.removeprefix(_PREFIXES.get(column.topic, ''))
            yield name, column._replace(field=field) if column.topic else column


for _kind in (Log, TrackLog):
    _kind.declared = MappingProxyType(dict(_declared(_kind)))
#: What every log declares, by name.
COLUMNS = Log.declared
_FLAGS = {'missed', 'saturated', 'steer_saturated'}


def columns_of(topic: str) -> dict[str, str]:
    """Return the columns that a topic's messages hold: names by field."""
    # The command is declared once, for APPLIED_COMMAND. A bag of a simulator that does not publish
    # this topic has the controller's commands alone: they fill the same two columns.
    if topic == ECU:
        return {'motor': 'motor', 'servo': 'servo'}
    columns = TrackLog.declared.items()
    return {column.field: name for name, column in columns if column.topic == topic}


def columns_from(topic: str, record: Any) -> dict[str, Any]:  # noqa: ANN401 (a NamedTuple)
    """Return the columns that a topic's messages hold, from a record of the messages' fields.

    A field without a column is left out.
    """
    return {name: getattr(record, field) for field, name in columns_of(topic).items()}


def log_of(
    period_ns: int,
    measured: Any,  # noqa: ANN401 (records of arrays)
    error: Any,  # noqa: ANN401
    command: Any,  # noqa: ANN401
    around: Any,  # noqa: ANN401
    on_track: Any = None,  # noqa: ANN401
    **computed: Floats,
) -> Log:
    """Return a log of steps of `period_ns`: observations, commands, and what controllers computed.

    The records have arrays of shape `(n,)` as fields.
    """
    n = len(around.theta)
    columns = {
        't': np.arange(n) * period_ns / 1e9,
        **columns_from(STATE, measured),
        **columns_from(STATE_ERROR, error),
        'motor': command.motor,
        'servo': command.servo,
        'missed': np.zeros(n),
        **columns_from(ENVIRONMENT, around),
    }
    if not on_track:
        return log_of_columns(Log, computed | columns)
    columns |= columns_from(TRACK_STATE, on_track)
    return log_of_columns(TrackLog, computed | columns)


def log_of_columns(kind: type[Log], columns: Mapping[str, Floats]) -> Log:
    """Return the log of these columns and own terms; a column that is absent is unknown."""
    unknown = np.full(len(columns['t']), np.nan)
    declared: dict[str, Any] = {name: columns.get(name, unknown) for name in kind.declared}
    flags = {name: declared[name] == 1.0 for name in declared.keys() & _FLAGS}
    terms = {name: columns[name] for name in columns if name not in kind.declared}
    return kind(**declared | flags, own_terms=terms)


def recordable(terms: Iterable[str]) -> tuple[str, ...]:
    """Return the terms that can be stored: a PID's, and those without a column of their name."""
    return tuple(name for name in terms if name in PID.terms or name not in COLUMNS)


def _in_words(log: Log) -> str:
    if not len(log):
        return 'no states'
    words = [f'{len(log)} states', f'{log.t[-1]:.2f} s', f'{log.distance[-1]:.1f} m']
    errors = log.speed_error[np.isfinite(log.speed_error)]
    if errors.size:
        words.append(f'speed error {np.sqrt(np.mean(errors**2)):.3f} m/s RMS')
    missed = np.count_nonzero(log.missed)
    if missed:
        words.append(f'{missed} missed deadlines')
    return ', '.join(words)
