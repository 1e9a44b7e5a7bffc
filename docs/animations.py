"""The animations at the top of README and of these pages: `python docs/figures.py animation`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure

from barc_sim.control.driver import Driver, DriverInput
from barc_sim.figures.views import SIZE, SideView, TopView, frames
from barc_sim.interfaces.records import Command
from barc_sim.simulation.closed_loop import simulate
from barc_sim.simulation.log import COLUMNS, Log
from barc_sim.vehicle.bike_model import BicycleState, Vehicle, motion, step

if TYPE_CHECKING:
    from barc_sim.figures.views import RunView

IMAGES = Path(__file__).parents[1] / 'resource' / 'images'
#: [s] Times of the figure of eight.
_START_OF_LEFT = 1.0
_END_OF_SPEEDING = 1.3
_START_OF_RIGHT = 8.7


def eight_by_hand(ts: float = 0.02) -> Log:
    """Return the log of a figure of eight, driven with the arrow keys."""
    vehicle = Vehicle()
    driver = Driver()
    state = BicycleState()
    command = Command()
    last_call = -1.0
    rows = []
    for k in range(round(16.0 / ts)):
        t = k * ts
        if t - last_call > driver.dt - 1e-9:
            last_call = t
            driver.receive(_keys(t), t)
            command = driver.command(t, state.v)

        now = motion(state, command.servo, vehicle)
        rows.append((t, now.x, now.y, now.psi, now.v_x, now.v_y, now.psi_dot, *command))
        state = step(state, command, 0.0, vehicle, ts)

    columns = dict.fromkeys(COLUMNS, np.zeros(len(rows)))
    columns['reference'] = np.full(len(rows), np.nan)
    names = ('t', 'x', 'y', 'psi', 'v_x', 'v_y', 'psi_dot', 'motor', 'servo')
    for name, values in zip(names, np.array(rows).T, strict=True):
        columns[name] = values
    return Log(**columns)


def _keys(t: float) -> DriverInput:
    """Return the keys at a time [s]: ahead at the start, then left, then right."""
    speed = 1.0 if t < _END_OF_SPEEDING else 0.0
    if t < _START_OF_LEFT:
        return DriverInput(speed, 0.0)
    if t < _START_OF_RIGHT:
        return DriverInput(speed, 1.0)
    return DriverInput(speed, -1.0)


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
    stills = [Image.fromarray(frame).convert('RGB') for frame in frames(view, times)]
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
