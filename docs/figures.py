"""Draws the figures of these pages from the package, light and dark: `python docs/figures.py`.

`python docs/figures.py animation` makes the animations at the top of README and of these pages.
"""

from __future__ import annotations

import sys
from math import atan, cos, radians, sin, tan
from pathlib import Path
from typing import TYPE_CHECKING, Any

import matplotlib as mpl
import numpy as np
from convergence import convergence_figure
from matplotlib import style
from matplotlib.figure import Figure
from matplotlib.patches import Arc, FancyArrowPatch, Rectangle
from matplotlib.transforms import Affine2D

import barc_sim
from barc_sim.control.driver import Driver, DriverInput
from barc_sim.control.speed import KI, KP, PID
from barc_sim.figures.colours import BLUE, DASHES, EARTH, GREEN, GREY, INK, MUTED, STYLE, SURFACE
from barc_sim.figures.colours import VERMILLION as RED
from barc_sim.figures.run_figures import speed_figure
from barc_sim.figures.track_figure import TRACK_GROUND, track_figure
from barc_sim.figures.views import SIZE, SideView, TopView, frames
from barc_sim.interfaces.records import Command, VehicleState
from barc_sim.simulation.closed_loop import simulate
from barc_sim.simulation.log import COLUMNS, Log
from barc_sim.vehicle.bicycles import Slip, bicycle_motion, bicycle_of, bicycle_step
from barc_sim.vehicle.bike_model import BicycleState, Vehicle, motion, slip_angle, step
from barc_sim.vehicle.road import LEVEL, Road

if TYPE_CHECKING:
    from collections.abc import Callable

    from barc_sim.figures.views import RunView


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
            low, high = self.output_min, self.output_max
            self.output_min, self.output_max = -np.inf, np.inf
            output = super().acc_calculate(reference, current, dt)
            self.output_min, self.output_max = low, high
            self.saturated = not low < output < high
            return min(max(output, low), high)

    return NoAntiWindup(**gains)


def bicycle() -> Figure:
    """Draw the kinematic bicycle with every angle and length of the derivation."""
    figure = Figure(figsize=(7.2, 4.6))
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    axes.set_aspect('equal')
    axes.axis('off')
    psi, d_f, l_f, l_r = radians(20.0), radians(32.0), 2.2, 2.2
    beta = atan(l_r / (l_f + l_r) * tan(d_f))
    along, across = np.array([cos(psi), sin(psi)]), np.array([-sin(psi), cos(psi)])
    rear, front = np.zeros(2), (l_f + l_r) * along
    centre = l_r * along
    icr = (l_f + l_r) / tan(d_f) * across

    def line(a: Any, b: Any, colour: str = INK, **kwargs: Any) -> None:
        axes.plot(*zip(a, b, strict=True), color=colour, **{'lw': 1.4} | kwargs)

    def wheel(at: Any, angle: float) -> None:
        turned = Affine2D().rotate(angle).translate(*at) + axes.transData
        axes.add_patch(
            Rectangle((-0.5, -0.15), 1.0, 0.3, color=SURFACE, transform=turned, zorder=3)
        )

    def arc(at: Any, radius: float, low: float, high: float, text: str) -> None:
        span = np.degrees([low, high])
        axes.add_patch(
            Arc(at, 2 * radius, 2 * radius, theta1=span[0], theta2=span[1], color=RED, lw=1.3)
        )
        mid = 0.5 * (low + high)
        put = np.asarray(at) + (radius + 0.28) * np.array([cos(mid), sin(mid)])
        axes.text(*put, text, color=RED, ha='center', va='center', fontsize=13)

    for wheel_at in (rear, front, centre):
        line(wheel_at, icr, GREY, ls=DASHES, lw=1.0)
    line(rear, front, INK, lw=2.4)
    wheel(rear, psi)
    wheel(front, psi + d_f)
    line(centre, np.add(centre, (3.0, 0.0)), GREY, lw=1.0)
    line(centre, centre + 3.2 * along, GREY, ls=DASHES, lw=1.0)
    line(front, front + 1.7 * along, GREY, ls=DASHES, lw=1.0)
    steered = np.array([cos(psi + d_f), sin(psi + d_f)])
    line(front, front + 1.7 * steered, GREY, ls=DASHES, lw=1.0)
    moving = np.array([cos(psi + beta), sin(psi + beta)])
    axes.add_patch(
        FancyArrowPatch(
            centre,
            centre + 2.6 * moving,
            color=BLUE,
            lw=2.2,
            mutation_scale=16,
            arrowstyle='-|>',
            shrinkA=0,
            shrinkB=0,
            zorder=4,
        )
    )
    axes.text(*(centre + 2.8 * moving), 'v', color=BLUE, fontsize=14, style='italic')
    arc(centre, 2.35, 0.0, psi, 'ψ')
    arc(centre, 1.5, psi, psi + beta, 'β')
    arc(front, 1.35, psi, psi + d_f, 'δ')
    axes.plot(*centre, 'o', color=INK, ms=6, zorder=5)
    axes.plot(*icr, 'o', color=GREEN, ms=6)
    axes.text(icr[0] - 0.2, icr[1] + 0.1, 'O', color=GREEN, fontsize=13, ha='right')
    below = -0.45 * across
    for a, b, text in ((rear, centre, r'$l_r$'), (centre, front, r'$l_f$')):
        axes.add_patch(
            FancyArrowPatch(
                a + below,
                b + below,
                color=MUTED,
                arrowstyle='<->',
                mutation_scale=9,
                shrinkA=0,
                shrinkB=0,
            )
        )
        axes.text(
            *(0.5 * (a + b) + 1.75 * below),
            text,
            color=MUTED,
            fontsize=13,
            ha='center',
            va='center',
            parse_math=True,
        )
    axes.text(*(0.5 * (icr + centre) + [-0.15, 0.1]), 'R', color=MUTED, fontsize=13, ha='right')
    axes.text(*(centre - [0.1, 0.45]), 'C', color=INK, fontsize=12)
    axes.autoscale_view()
    axes.set_xlim(-3.2, 7.4)
    axes.set_ylim(-1.4, 7.2)
    figure.set_size_inches(7.2, 5.8)
    return figure


def forces_on_the_hill() -> Figure:
    """Draw the forces along the road on an incline."""
    figure = Figure(figsize=(6.4, 3.2))
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    axes.set_aspect('equal')
    axes.axis('off')
    theta = radians(16.0)
    along, up = np.array([cos(theta), sin(theta)]), np.array([-sin(theta), cos(theta)])
    axes.fill(
        [-3.4, 4.6, 4.6],
        [-3.4 * tan(theta), 4.6 * tan(theta), -3.4 * tan(theta)],
        color=EARTH,
        zorder=0,
    )
    turned = Affine2D().rotate(theta).translate(*(0.18 * up)) + axes.transData
    axes.add_patch(Rectangle((-1.0, 0.1), 2.0, 0.55, color=SURFACE, transform=turned))
    middle = 0.5 * up

    def arrow(at: Any, to: Any, text: str, colour: str, at_text: Any) -> None:
        axes.add_patch(
            FancyArrowPatch(
                at,
                to,
                color=colour,
                lw=2.0,
                arrowstyle='-|>',
                mutation_scale=15,
                shrinkA=0,
                shrinkB=0,
                zorder=4,
            )
        )
        axes.text(*at_text, text, color=colour, fontsize=12, parse_math=True)

    front, rear = middle + 1.0 * along, middle - 1.0 * along
    arrow(front, front + 1.5 * along, '$m\\,a$', BLUE, front + 1.1 * along + 0.28 * up)
    arrow(rear, rear - 1.6 * along, '$m\\,g\\,\\sin\\theta$', RED, rear - 2.1 * along + 0.3 * up)
    drag = rear - 0.32 * up
    arrow(drag, drag - 0.9 * along, '$a_0 v^2 + F_f$', GREEN, drag - [0.45, 0.62])
    arrow(middle, middle - [0.0, 1.7], '$m\\,g$', MUTED, middle - [-0.12, 1.55])
    corner = np.array([-3.4, -3.4 * tan(theta)])
    axes.add_patch(Arc(corner, 2.4, 2.4, theta1=0.0, theta2=16.0, color=INK, lw=1.2))
    axes.text(*(np.add(corner, (1.3, 0.12))), 'θ', color=INK, fontsize=13)
    axes.set_xlim(-3.8, 4.8)
    axes.set_ylim(-1.45, 2.5)
    return figure


def course() -> Figure:
    """Draw the lab's road."""
    road = Road.lab()
    figure = Figure(figsize=(9.0, 2.6))
    figure.set_layout_engine('constrained')
    axes = figure.subplots()
    s = np.linspace(0.0, 180.0, 361)
    height = np.array([road.elevation(each) for each in s])
    axes.fill_between(s, -2.0, height, color=EARTH, lw=0.0)
    axes.plot(s, height, color=SURFACE, lw=2.2)
    for start, grade in zip(road.starts, road.grades_deg, strict=True):
        side = 'right' if grade > 0.0 else 'left' if grade < 0.0 else 'center'  # beside a slope
        axes.text(
            start + 10.0, road.elevation(start + 10.0) + 0.9, f'{grade:g}°', ha=side, color=INK
        )
    axes.set_ylim(-2.0, 13.0)
    axes.set_xlim(0.0, 180.0)
    axes.set_xlabel('Position along the road [m]')
    axes.set_ylabel('Elevation [m]')
    return figure


def drive_of_the_lab() -> Figure:
    """Draw the run with the default gains."""
    return speed_figure(simulate(), title='The course with the default gains')


def kinematic_and_dynamic() -> Figure:
    """Draw yaw rate over speed, and the way of both bicycles at 20 m/s."""
    figure = Figure(figsize=(9.0, 3.8))
    figure.set_layout_engine('constrained', w_pad=0.1)
    rate, way = figure.subplots(1, 2)
    steering = 0.05
    speeds = np.arange(4.0, 31.0, 1.0)
    vehicle = Vehicle(air_drag_coeff=0.0, friction=0.0)

    def driven(dynamics: str, v: float, steps: int) -> list[VehicleState]:
        bicycle = bicycle_of(dynamics, 'rk4', vehicle)
        held = Command(0.0, steering)
        state, slip = BicycleState(v=v), Slip()
        motions = []
        for _ in range(steps):
            state, slip = bicycle_step(bicycle, state, slip, held, LEVEL, 0, 0.005)
            motions.append(bicycle_motion(bicycle, state, slip, steering))
        return motions

    kinematic = [v / vehicle.l_r * sin(slip_angle(steering)) for v in speeds]
    dynamic = [driven('dynamic', v, 600)[-1].psi_dot for v in speeds]
    rate.plot(speeds, np.degrees(kinematic), color=BLUE, label='kinematic')
    rate.plot(speeds, np.degrees(dynamic), color=RED, label='dynamic')
    rate.set_xlabel('Speed [m/s]')
    rate.set_ylabel('Steady yaw rate [°/s]')
    rate.set_title('Steering 0.05 rad', loc='left', fontsize=11)
    rate.legend()
    for name, colour in (('kinematic', BLUE), ('dynamic', RED)):
        states = driven(name, 20.0, 800)
        way.plot([s.x for s in states], [s.y for s in states], color=colour, label=name)
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
    runs = {
        'P: kp 30': (GREEN, simulate(KP, 0.0, 0.0, road=HILL, distance=110.0)),
        'PI: kp 30, ki 200': (BLUE, simulate(KP, KI, 0.0, road=HILL, distance=110.0)),
    }
    for axes in (speed, terms):
        axes.axvspan(40.0, 80.0, color=EARTH, lw=0.0, zorder=0)
    for name, (colour, log) in runs.items():
        speed.plot(log.distance, log.speed, color=colour, label=name)
    speed.axhline(8.0, color=MUTED, ls=DASHES, lw=1.0)
    speed.set_ylim(7.85, 8.15)
    speed.set_ylabel('Speed [m/s]')
    speed.legend(loc='upper right', ncols=2)
    log = runs['PI: kp 30, ki 200'][1]
    terms.plot(log.distance, log.proportional, color=RED, label='P')
    terms.plot(log.distance, log.integral, color=BLUE, label='I')
    terms.plot(log.distance, log.motor, color=INK, lw=1.0, label='command')
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
    for name, colour, log in (
        ('with anti-windup', BLUE, simulate(**gains, road='flat', distance=60.0)),
        ('without', RED, simulate(controller=windup_free(gains), road='flat', distance=60.0)),
    ):
        speed.plot(log.t, log.speed, color=colour, label=name)
        integral.plot(log.t, log.integral, color=colour)
    speed.axhline(8.0, color=MUTED, ls=DASHES, lw=1.0)
    speed.set_ylabel('Speed [m/s]')
    speed.legend(loc='lower right')
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


def _newest_source() -> float:
    package = Path(barc_sim.__file__).parent
    rooms = ('vehicle', 'control', 'simulation', 'figures')
    sources = [Path(__file__), *(path for room in rooms for path in (package / room).rglob('*.py'))]
    return max(path.stat().st_mtime for path in sources)


def draw_missing() -> None:
    """Draw the figures that are not there, or are older than what draws them."""
    FOLDER.mkdir(exist_ok=True)
    newest = _newest_source()
    for name, make in FIGURES.items():
        light, dark = (FOLDER / f'{name}-{look}.svg' for look in ('light', 'dark'))
        if dark.is_file() and dark.stat().st_mtime > newest:
            continue
        with style.context(STYLE):
            figure = make()
        with mpl.rc_context({'svg.hashsalt': name, 'svg.fonttype': 'path'}):
            figure.savefig(light, transparent=True, metadata={'Date': None})
        text = light.read_text(encoding='utf-8')
        for bright, dim in DARK.items():
            text = text.replace(bright.lower(), dim.lower())
        dark.write_text(text, encoding='utf-8')


def eight_by_hand(ts: float = 0.02) -> Log:
    """Return the log of a figure of eight, driven with the arrow keys."""
    vehicle, driver, state = Vehicle(), Driver(), BicycleState()
    command, called, rows = Command(), -1.0, []
    for k in range(round(16.0 / ts)):
        t = k * ts
        if t - called > driver.dt - 1e-9:
            called = t
            turn = 0.0 if t < 1.0 else 1.0 if t < 8.7 else -1.0  # noqa: PLR2004 (the keys held)
            driver.receive(DriverInput(float(t < 1.3), turn), t)  # noqa: PLR2004
            command = driver.command(t, state.v)
        now = motion(state, command.servo, vehicle)
        rows.append((t, now.x, now.y, now.psi, now.v_x, now.v_y, now.psi_dot, *command))
        state = step(state, command, 0.0, vehicle, ts)
    zeros = np.zeros(len(rows))
    names = ('t', 'x', 'y', 'psi', 'v_x', 'v_y', 'psi_dot', 'motor', 'servo')
    columns = dict.fromkeys(COLUMNS, zeros) | {'reference': np.full(len(rows), np.nan)}
    return Log(**(columns | dict(zip(names, np.array(rows).T, strict=True))))


def animate() -> None:
    """Save the hills from the side, and a drive by hand from above."""
    size = (0.86 * SIZE[0], 0.86 * SIZE[1])  # so that the words are large in a small picture
    figure = Figure(figsize=size, dpi=640 / size[0])
    _save(IMAGES / 'course.webp', SideView(simulate(), figure, title='barc acc'), 12)
    # Smaller, as all of it moves.
    figure = Figure(figsize=size, dpi=480 / size[0])
    _save(IMAGES / 'drive.webp', TopView(eight_by_hand(), figure, title='barc teleop'), 8)


def _save(path: Path, view: RunView, fps: int, seconds: float = 15.0) -> None:
    """Save the last `seconds` of a view as a WebP of few colours."""
    from PIL import Image  # noqa: PLC0415 (for this alone)

    times = np.arange(view.duration - seconds, view.duration, 1.0 / fps)
    stills = [Image.fromarray(each).convert('RGB') for each in frames(view, times)]
    stills[0].save(
        path,
        save_all=True,
        append_images=stills[1:],
        duration=1000 // fps,
        loop=0,
        quality=50,
        method=4,
        minimize_size=True,
    )


if __name__ == '__main__':
    if sys.argv[1:] == ['animation']:
        animate()
    else:
        draw_missing()
