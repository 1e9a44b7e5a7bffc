"""Draws the figures of these pages from the package, light and dark: `python docs/figures.py`.

`python docs/figures.py animation` makes the animations at the top of README and of these pages.
"""

from __future__ import annotations

import sys
from math import sin
from pathlib import Path
from typing import TYPE_CHECKING

import matplotlib as mpl
import numpy as np
from animations import animate
from convergence import convergence_figure
from matplotlib import style
from matplotlib.figure import Figure
from sketches import bicycle, forces_on_the_hill

import barc_sim
from barc_sim.control.speed import KI, KP, PID
from barc_sim.figures.colours import BLUE, DASHES, EARTH, GREEN, GREY, INK, MUTED, STYLE, SURFACE
from barc_sim.figures.colours import VERMILLION as RED
from barc_sim.figures.run_figures import speed_figure
from barc_sim.figures.track_figure import TRACK_GROUND, track_figure
from barc_sim.interfaces.records import Command, VehicleState
from barc_sim.simulation.closed_loop import simulate
from barc_sim.vehicle.bicycles import Slip, bicycle_motion, bicycle_of, bicycle_step
from barc_sim.vehicle.bike_model import BicycleState, Vehicle, slip_angle
from barc_sim.vehicle.road import LEVEL, Road

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    Vector = NDArray[np.float64]  #: x and y


HERE = Path(__file__).parent
FOLDER = HERE / '_figures'
IMAGES = HERE.parent / 'resource' / 'images'
#: The colours of the dark figures, by those of the light ones.
DARK = {
    INK: '#E8E8E8',
    MUTED: '#B0B0B0',
    GREY: '#8C8C8C',
    BLUE: '#56A8E0',
    RED: '#F0834D',
    GREEN: '#2FC49A',
    EARTH: '#3A3833',
    SURFACE: '#A8A294',
    TRACK_GROUND: '#242628',
    '#E9E9E9': '#3A3A3A',
    '#000000': '#E8E8E8',
    '#FFFFFF': '#131416',
}
#: One hill of 10°, after a stretch on which the car reaches its speed.
HILL = Road((0.0, 40.0, 80.0), (0.0, 10.0, 0.0), name='one hill')


def windup_free(gains: dict[str, float]) -> PID:
    """Return a PID whose integral does not stop at the limit: what anti-windup prevents."""

    class NoAntiWindup(PID):
        """The same PID, limited after the sum, so that its integral winds up."""

        def acc_calculate(self, reference: float, current: float, dt: float = 0.02) -> float:
            low = self.output_min
            high = self.output_max
            self.output_min = -np.inf
            self.output_max = np.inf
            output = super().acc_calculate(reference, current, dt)

            self.output_min = low
            self.output_max = high
            self.saturated = not low < output < high
            return min(max(output, low), high)

    return NoAntiWindup(**gains)


def course() -> Figure:
    """Draw the lab's road."""
    road = Road.lab()
    figure = Figure(figsize=(9.0, 2.6))
    figure.set_layout_engine('constrained')
    axes = figure.subplots()

    s = np.linspace(0.0, 180.0, 361)
    elevation = np.array([road.elevation(position) for position in s])
    axes.fill_between(s, -2.0, elevation, color=EARTH, lw=0.0)
    axes.plot(s, elevation, color=SURFACE, lw=2.2)
    for start, grade in zip(road.starts, road.grades_deg, strict=True):
        x = start + 10.0
        y = road.elevation(x) + 0.9
        axes.text(x, y, f'{grade:g}°', ha=_side_of_slope(grade), color=INK)

    axes.set_ylim(-2.0, 13.0)
    axes.set_xlim(0.0, 180.0)
    axes.set_xlabel('Position along the road [m]')
    axes.set_ylabel('Elevation [m]')
    return figure


def _side_of_slope(grade: float) -> str:
    """Return the end of a text that is nearest to the slope, so that the text is beside it."""
    if grade > 0.0:
        return 'right'
    if grade < 0.0:
        return 'left'
    return 'center'


def drive_of_the_lab() -> Figure:
    """Draw the run with the default gains."""
    return speed_figure(simulate(), title='The course with the default gains')


def _motions(dynamics: str, v: float, steps: int, steering: float) -> list[VehicleState]:
    """Return the motions of a bicycle that begins straight, with constant steering [rad]."""
    bicycle = bicycle_of(dynamics, 'rk4', Vehicle(air_drag_coeff=0.0, friction=0.0))
    command = Command(0.0, steering)
    state = BicycleState(v=v)
    slip = Slip()
    motions = []
    for _ in range(steps):
        state, slip = bicycle_step(bicycle, state, slip, command, LEVEL, 0, 0.005)
        motions.append(bicycle_motion(bicycle, state, slip, steering))
    return motions


def kinematic_and_dynamic() -> Figure:
    """Draw yaw rate over speed, and the way of both bicycles at 20 m/s."""
    figure = Figure(figsize=(9.0, 3.8))
    figure.set_layout_engine('constrained', w_pad=0.1)
    rate, way = figure.subplots(1, 2)
    steering = 0.05
    speeds = np.arange(4.0, 31.0, 1.0)
    kinematic = [v / Vehicle().l_r * sin(slip_angle(steering)) for v in speeds]
    dynamic = [_motions('dynamic', v, 600, steering)[-1].psi_dot for v in speeds]

    rate.plot(speeds, np.degrees(kinematic), color=BLUE, label='kinematic')
    rate.plot(speeds, np.degrees(dynamic), color=RED, label='dynamic')
    rate.set_xlabel('Speed [m/s]')
    rate.set_ylabel('Steady yaw rate [°/s]')
    rate.set_title('Steering 0.05 rad', loc='left', fontsize=11)
    rate.legend()

    for name, colour in (('kinematic', BLUE), ('dynamic', RED)):
        motions = _motions(name, 20.0, 800, steering)
        xs = [motion.x for motion in motions]
        ys = [motion.y for motion in motions]
        way.plot(xs, ys, color=colour, label=name)
    way.set_aspect('equal')
    way.set_xlabel('x [m]')
    way.set_ylabel('y [m]')
    way.set_title('4 s at 20 m/s', loc='left', fontsize=11)
    way.legend()
    return figure


def hill() -> Figure:
    """Draw speed and terms of the PID over one hill, with P alone, PI, and the default PID."""
    figure = Figure(figsize=(9.0, 5.4))
    figure.set_layout_engine('constrained', h_pad=0.08)
    speed, terms = figure.subplots(2, 1, sharex=True)
    for axes in (speed, terms):
        axes.axvspan(40.0, 80.0, color=EARTH, lw=0.0, zorder=0)

    p = simulate(KP, 0.0, 0.0, road=HILL, distance=110.0)
    pi = simulate(KP, KI, 0.0, road=HILL, distance=110.0)
    speed.plot(p.distance, p.speed, color=GREEN, label='P: kp 30')
    speed.plot(pi.distance, pi.speed, color=BLUE, label='PI: kp 30, ki 200')
    speed.axhline(8.0, color=MUTED, ls=DASHES, lw=1.0)
    speed.set_ylim(7.85, 8.15)
    speed.set_ylabel('Speed [m/s]')
    speed.legend(loc='upper right', ncols=2)

    terms.plot(pi.distance, pi.proportional, color=RED, label='P')
    terms.plot(pi.distance, pi.integral, color=BLUE, label='I')
    terms.plot(pi.distance, pi.motor, color=INK, lw=1.0, label='command')
    terms.set_xlim(30.0, 110.0)
    terms.set_ylim(-2.6, 4.2)
    terms.set_ylabel('Terms of PI [m/s²]')
    terms.set_xlabel('Position along the road [m]; the hill of 10° is shaded')
    terms.legend(loc='upper right', ncols=3)
    return figure


def laps_of_the_l() -> Figure:
    """Draw laps of the L with two steering laws."""
    log = barc_sim.lap(barc_sim.Stanley(), speed=6.0, laps=2, dynamics='dynamic')
    other = barc_sim.lap(speed=6.0, laps=2, dynamics='dynamic')
    return track_figure(log, other, labels=['Stanley', 'LaneLQR'])


def windup() -> Figure:
    """Draw the start from standstill with and without anti-windup."""
    figure = Figure(figsize=(9.0, 5.0))
    figure.set_layout_engine('constrained', h_pad=0.08)
    speed, integral = figure.subplots(2, 1, sharex=True)
    gains = {'kp': KP, 'ki': KI, 'kd': 0.0}
    log = simulate(**gains, road='flat', distance=60.0)
    log_without = simulate(controller=windup_free(gains), road='flat', distance=60.0)

    speed.plot(log.t, log.speed, color=BLUE, label='with anti-windup')
    speed.plot(log_without.t, log_without.speed, color=RED, label='without')
    speed.axhline(8.0, color=MUTED, ls=DASHES, lw=1.0)
    speed.set_ylabel('Speed [m/s]')
    speed.legend(loc='lower right')

    integral.plot(log.t, log.integral, color=BLUE)
    integral.plot(log_without.t, log_without.integral, color=RED)
    integral.set_ylabel('Integral [m/s²]')
    integral.set_xlabel('Time [s]')
    return figure


FIGURES: dict[str, Callable[[], Figure]] = {
    'bicycle': bicycle,
    'convergence': convergence_figure,
    'course': course,
    'drive': drive_of_the_lab,
    'forces': forces_on_the_hill,
    'hill': hill,
    'laps': laps_of_the_l,
    'kinematic-dynamic': kinematic_and_dynamic,
    'windup': windup,
}


def draw_missing() -> None:
    """Draw the figures that are not there, or are older than what draws them."""
    FOLDER.mkdir(exist_ok=True)
    newest = _newest_source()
    for name, make in FIGURES.items():
        light = FOLDER / f'{name}-light.svg'
        dark = FOLDER / f'{name}-dark.svg'
        if dark.is_file() and dark.stat().st_mtime > newest:
            continue

        with style.context(STYLE):
            figure = make()
        with mpl.rc_context({'svg.hashsalt': name, 'svg.fonttype': 'path'}):
            figure.savefig(light, transparent=True, metadata={'Date': None})
        dark.write_text(_darken(light.read_text(encoding='utf-8')), encoding='utf-8')


def _newest_source() -> float:
    """Return the time of the last change of these programs and of the package's rooms."""
    package = Path(barc_sim.__file__).parent
    sources = [*HERE.glob('*.py')]
    for room in ('vehicle', 'control', 'simulation', 'figures'):
        sources += (package / room).rglob('*.py')
    return max(path.stat().st_mtime for path in sources)


def _darken(svg: str) -> str:
    for light, dark in DARK.items():
        svg = svg.replace(light.lower(), dark.lower())
    return svg


if __name__ == '__main__':
    if sys.argv[1:] == ['animation']:
        animate()
    else:
        draw_missing()
