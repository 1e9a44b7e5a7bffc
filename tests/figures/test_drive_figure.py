"""The figure of a drive by hand."""

from __future__ import annotations

from dataclasses import replace
from math import sin

import numpy as np

from barc_sim.control.driver import DriverInput
from barc_sim.figures.run_figures import drive_figure
from barc_sim.simulation.closed_loop import drive_by_hand

REQUESTS = [(0.2 * k, DriverInput(forward=0.5, turn=0.5 * sin(k / 5))) for k in range(40)]


def test_path_heading_speed_and_steering_are_drawn() -> None:
    log = drive_by_hand(REQUESTS, 8.0)
    path, heading, speed, steering = drive_figure(log, title='mine').axes
    assert path.get_title(loc='left') == 'mine'
    assert path.get_aspect() == 1.0
    np.testing.assert_array_equal(path.lines[0].get_xydata(), np.c_[log.distance, log.across])
    assert heading.lines[0].get_ydata()[-1] == np.degrees(log.psi[-1])
    np.testing.assert_array_equal(speed.lines[0].get_xydata(), np.c_[log.t, log.speed])
    assert steering.lines[0].get_ydata().max() == np.degrees(log.servo.max())
    assert 'Time [s]' in steering.get_xlabel()


def test_reset_to_the_start_breaks_the_lines() -> None:
    log = drive_by_hand(REQUESTS, 8.0)
    x = np.where(log.t < 6.0, log.x, 0.0)
    path, _, speed, _ = drive_figure(replace(log, x=x)).axes
    k = int(np.searchsorted(log.t, 6.0)) - 1
    assert np.isnan(path.lines[0].get_xdata()).nonzero()[0].tolist() == [k]
    assert np.isnan(speed.lines[0].get_ydata()).nonzero()[0].tolist() == [k]


def test_drive_of_one_state_and_without_commands_is_drawn() -> None:
    log = drive_by_hand(REQUESTS, 0.0)
    assert len(drive_figure(log.map(lambda column: column[:1])).axes) == 4
