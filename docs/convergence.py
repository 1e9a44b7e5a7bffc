"""How fast the error of a step falls with its length, for each model and integrator.

Each test drive has a constant command. Its last state is compared with a closed form, or with a
solution in far shorter steps. `python docs/convergence.py` prints the errors.
"""

from __future__ import annotations

from itertools import groupby
from math import atanh, ceil, cos, hypot, inf, log, sin, sinh, sqrt
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from matplotlib import style
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, FuncFormatter, NullLocator

from barc_sim.figures.colours import BLUE, DASHES, EARTH, GREY, INK, MUTED, STYLE, VERMILLION
from barc_sim.interfaces.records import Command
from barc_sim.vehicle.bicycles import INTEGRATORS, Slip, bicycle_of, bicycle_step
from barc_sim.vehicle.bike_model import BicycleState, Vehicle, slip_angle
from barc_sim.vehicle.road import LEVEL, Inclines, Road, stretch_at

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from matplotlib.axes import Axes

#: [s] The lab's step, halved again and again.
STEPS = tuple(0.02 / 2**k for k in range(5))
#: [s] Step of the rk4 solution to compare with where there is no closed form.
FINE = 0.02 / 128
#: [m] Smaller errors come from rounding, not from the method.
ROUNDING = 1e-11
_COLUMNS = 3  #: of panels
_COLOURS = {'euler': VERMILLION, 'rk4': BLUE}
_NAMES = {'euler': 'forward Euler', 'rk4': 'Runge-Kutta (rk4)'}
#: Marker, whether it is filled, and its size: both models are visible if their errors are equal.
_MARKERS = {'kinematic': ('o', True, 4.5), 'dynamic': ('s', False, 8.0)}
_SLOPES = {1: 2e-3, 4: 1e-9}  # order, and error [m] at the longest step

_LAB = Road.lab()


class ReferenceDrive(NamedTuple):
    """A test drive of the bicycles named in `models`."""

    name: str
    text: str
    start: BicycleState
    duration: float  #: [s]
    command: Command = Command()
    inclines: Inclines = LEVEL
    vehicle: Vehicle = Vehicle()
    models: tuple[str, ...] = ('kinematic', 'dynamic')
    exact: Callable[[ReferenceDrive], tuple[float, float]] | None = None  #: x and y [m] at the end


def _slope(degrees: float) -> Inclines:
    """Return the inclines of a road of one grade."""
    return Road((0.0,), (degrees,)).inclines()


def _circle(test_drive: ReferenceDrive) -> tuple[float, float]:
    """Return where a circle at constant speed ends."""
    beta = slip_angle(test_drive.command.servo)
    radius = test_drive.vehicle.l_r / sin(beta)
    angle = test_drive.start.v * test_drive.duration / radius
    return radius * (sin(angle + beta) - sin(beta)), radius * (cos(beta) - cos(angle + beta))


def _descent(test_drive: ReferenceDrive) -> tuple[float, float]:
    """Return how far a car rolls that slows down to where drag and friction balance gravity."""
    vehicle = test_drive.vehicle
    weight = vehicle.mass * vehicle.gravity
    pull = -weight * sin(test_drive.inclines.thetas[0]) - vehicle.friction
    terminal = sqrt(pull / vehicle.air_drag_coeff)
    rate = sqrt(pull * vehicle.air_drag_coeff) / vehicle.mass
    begin = atanh(terminal / test_drive.start.v)
    ratio = sinh(begin + rate * test_drive.duration) / sinh(begin)
    return terminal / rate * log(ratio), 0.0


def _stretches(test_drive: ReferenceDrive) -> tuple[float, float]:
    """Return how far a car without drag comes on stretches of constant grade."""
    vehicle = test_drive.vehicle
    inclines = test_drive.inclines
    time_left = test_drive.duration
    x = test_drive.start.x
    v = test_drive.start.v

    for end, theta in zip((*inclines.starts[1:], inf), inclines.thetas, strict=True):
        resistance = vehicle.friction / vehicle.mass
        a = test_drive.command.motor - vehicle.gravity * sin(theta) - resistance
        time = inf
        if end < inf:
            time = 2.0 * (end - x) / (v + sqrt(v * v + 2.0 * a * (end - x)))
        if time > time_left:
            break

        x = end
        v += a * time
        time_left -= time

    return x + time_left * (v + 0.5 * a * time_left), 0.0


REFERENCE_DRIVES = (
    ReferenceDrive(
        name='circle',
        text='15 m/s, 0.4 rad',
        start=BicycleState(v=15.0),
        command=Command(0.0, 0.4),
        vehicle=Vehicle(air_drag_coeff=0.0, friction=0.0),
        duration=4.0,
        models=('kinematic',),
        exact=_circle,
    ),
    ReferenceDrive(
        name='step steer',
        text='20 m/s, 0.05 rad',
        start=BicycleState(v=20.0),
        command=Command(0.0, 0.05),
        duration=4.0,
        models=('dynamic',),
    ),
    ReferenceDrive(
        name='descent',
        text='30° down, strong drag',
        start=BicycleState(v=20.0),
        inclines=_slope(-30.0),
        vehicle=Vehicle(mass=1000.0, air_drag_coeff=200.0, friction=50.0),
        duration=2.0,
        exact=_descent,
    ),
    ReferenceDrive(
        name='bend downhill',
        text='10° down, strong drag, 0.03 rad',
        start=BicycleState(v=25.0),
        command=Command(0.5, 0.03),
        inclines=_slope(-10.0),
        vehicle=Vehicle(air_drag_coeff=100.0),
        duration=4.0,
    ),
    ReferenceDrive(
        name="lab's road",
        text='its grade jumps',
        start=BicycleState(v=8.0),
        command=Command(3.0),
        inclines=_LAB.inclines(),
        vehicle=Vehicle(air_drag_coeff=0.0),
        duration=8.0,
        exact=_stretches,
    ),
)


class Study(NamedTuple):
    """The errors of one integrator of one model in one test drive."""

    test_drive: ReferenceDrive
    model: str
    integrator: str
    errors: tuple[float, ...]  #: [m] of the position at the end, for each of `STEPS`
    order: float  #: the slope of the errors; NaN where rounding leaves fewer than two of them


def studies() -> Iterator[Study]:
    """Yield the study of each test drive, model and integrator."""
    for test_drive in REFERENCE_DRIVES:
        for model in test_drive.models:
            x, y = _true_end(test_drive, model)
            for integrator in INTEGRATORS:
                ends = [final_state(test_drive, model, integrator, ts) for ts in STEPS]
                errors = tuple(hypot(end.x - x, end.y - y) for end in ends)
                yield Study(test_drive, model, integrator, errors, order(errors))


def _true_end(test_drive: ReferenceDrive, model: str) -> tuple[float, float]:
    """Return x and y [m] at the end, by a closed form or by steps that are far shorter."""
    if test_drive.exact:
        return test_drive.exact(test_drive)
    end = final_state(test_drive, model, 'rk4', FINE)
    return end.x, end.y


def final_state(test_drive: ReferenceDrive, model: str, integrator: str, ts: float) -> BicycleState:
    """Return the state at the end, in steps of `ts` seconds."""
    bicycle = bicycle_of(model, integrator, test_drive.vehicle)
    command = test_drive.command
    inclines = test_drive.inclines
    state = test_drive.start
    slip = Slip()
    stretch = 0

    for _ in range(round(test_drive.duration / ts)):
        stretch = stretch_at(inclines.starts, state.x, stretch)
        state, slip = bicycle_step(bicycle, state, slip, command, inclines, stretch, ts)
    return state


def order(errors: tuple[float, ...]) -> float:
    """Return the slope of log error over log step, for errors [m] of `STEPS`."""
    points = [(ts, error) for ts, error in zip(STEPS, errors, strict=True) if error > ROUNDING]
    if len(points) < 2:  # noqa: PLR2004 (a slope needs two of them)
        return float('nan')

    log_steps, log_errors = np.log(points).T
    slope, _ = np.polyfit(log_steps, log_errors, 1)
    return float(slope)


@style.context(STYLE)
def convergence_figure() -> Figure:
    """Draw the errors of the studies, those of a test drive next to each other."""
    figure = Figure(figsize=(11.0, 6.8))
    figure.set_layout_engine('constrained', w_pad=0.08, h_pad=0.12)
    groups = [[*group] for _, group in groupby(studies(), lambda study: study.test_drive.name)]
    rows = ceil((len(groups) + 1) / _COLUMNS)
    grid = figure.subplots(rows, _COLUMNS, sharex=True, sharey=True, squeeze=False)
    panels = [*grid.flat]

    for panel, group in zip(panels, groups, strict=False):
        _draw(panel, group)
        panel.tick_params(labelbottom=True)
        panel.set_xlabel('Step [ms]')
    for panel in panels[len(groups) :]:
        panel.set_axis_off()
    _explain(panels[-1])
    for row in grid:
        row[0].set_ylabel('Error [m]')

    figure.suptitle(
        'Error of the position at the end of a drive, by the length of the step',
        x=0.01,
        ha='left',
        fontsize=14,
        fontweight='bold',
    )
    return figure


def _draw(axes: Axes, group: list[Study]) -> None:
    for study in group:
        errors = np.maximum(study.errors, np.finfo(float).tiny)
        axes.loglog(STEPS, errors, **_line(study.integrator, study.model))
    _draw_slopes(axes)
    axes.axhspan(1e-14, ROUNDING, color=EARTH, alpha=0.6, lw=0.0, zorder=0)
    axes.set_ylim(1e-13, 1.0)
    axes.xaxis.set_major_locator(FixedLocator(STEPS))
    axes.xaxis.set_major_formatter(FuncFormatter(lambda ts, _: f'{1e3 * ts:g}'))
    axes.xaxis.set_minor_locator(NullLocator())

    drive = group[0].test_drive
    reference = 'the closed form' if drive.exact else 'a fine solution'
    axes.set_title(drive.name, loc='left', fontsize=11, fontweight='bold', pad=18.0)
    text = axes.annotate(
        f'{drive.text}; against {reference}',
        xy=(0.0, 1.0),
        xytext=(0.0, 5.0),
        xycoords='axes fraction',
        textcoords='offset points',
        color=MUTED,
        fontsize=9,
    )
    text.set_in_layout(False)  # a long one must not move the panels apart


def _draw_slopes(axes: Axes) -> None:
    for order, error in _SLOPES.items():
        line = [error * (ts / STEPS[0]) ** order for ts in STEPS]
        axes.loglog(STEPS, line, color=GREY, lw=0.9, ls=DASHES, zorder=1)
        axes.annotate(
            f'{order}',
            xy=(STEPS[0], error),
            xytext=(5.0, 0.0),
            xycoords='data',
            textcoords='offset points',
            color=MUTED,
            fontsize=9,
            va='center',
        )


def _line(integrator: str, model: str) -> dict[str, Any]:
    """Return the look of a line."""
    colour = _COLOURS[integrator]
    marker, is_filled, size = _MARKERS[model]
    face = colour if is_filled else 'none'
    return {'c': colour, 'lw': 1.4, 'marker': marker, 'ms': size, 'mfc': face}


def _explain(axes: Axes) -> None:
    """Draw the legend in a panel of its own."""
    for integrator, name in _NAMES.items():
        for model in _MARKERS:
            axes.plot([], [], label=f'{name}, {model}', **_line(integrator, model))
    axes.plot([], [], color=GREY, lw=0.9, ls=DASHES, label='slopes 1 and 4')
    axes.fill_between([], [], color=EARTH, alpha=0.6, lw=0.0, label='rounding')
    axes.legend(loc='center left', labelcolor=INK, labelspacing=0.9)


if __name__ == '__main__':
    for study in studies():
        drive = f'{study.test_drive.name:15}{study.model:11}{study.integrator:7}'
        errors = ''.join(f'{error:10.1e}' for error in study.errors)
        print(f'{drive}{errors}{study.order:8.2f}')  # noqa: T201
