"""Lab 4, racing line and MPC: judges the speeds of a lap, a racing line, and an MPC's program.

Speeds and program are judged by their numbers, a line by how much it bends, and by the lateral
acceleration in laps at the speed that it allows. The time of a lap is not judged.
"""

from __future__ import annotations

from contextlib import suppress
from functools import cache, cached_property, partial
from math import inf
from typing import TYPE_CHECKING

import numpy as np

from barc_sim.control.lane import LaneLQR, speed_profile
from barc_sim.control.planning import bending, lap_time, racing_line, solver
from barc_sim.errors import UserError
from barc_sim.lab import files
from barc_sim.lab.files import POINTS
from barc_sim.lab.judge import Evidence, Finding, Functions, JudgedPart, Lab, share
from barc_sim.lab.labs.lane import hidden_track
from barc_sim.lab.law import read_law
from barc_sim.lab.user_code.adapters import line_along, line_arguments
from barc_sim.simulation.closed_loop import lap
from barc_sim.vehicle.bike_model import L_F, L_R
from barc_sim.vehicle.track import Track

if TYPE_CHECKING:
    from collections.abc import Iterator

    from matplotlib.figure import Figure

    from barc_sim.lab.confined.process import JudgedCode
    from barc_sim.lab.judge import Settings
    from barc_sim.lab.law import Floats
    from barc_sim.simulation.log import TrackLog

LABELS = {
    'speed.profile': 'Speed: profile of a lap',
    'line.inside': 'Line: between the edges',
    'line.bending': 'Line: how much it bends',
    'line.lap': 'Line: laps of L',
    'line.hidden': 'Line: a hidden track',
    'mpc.model': 'MPC: the model',
    'mpc.program': 'MPC: the quadratic program',
    'line.gain': 'Line: what it gains, and why',
}
LIMITS = 12.0, 3.5, 2.0  #: speed [m/s], lateral and longitudinal acceleration [m/s²]
_BENT = 1.1  #: times the bending of the best line: full marks
_LOAD = (1.1, 1.5)  #: times the limit of the lateral acceleration: full marks, none
_TOLERANCE = 1e-6
_L = Track.named('L')


def passed(limits: Floats, gain: Floats, *, closed: bool = True) -> Floats:
    """Return `limits` cut so that no row grows by more than its `gain` from point to point."""
    laps = np.tile(limits, 1 + closed)
    growth = gain[:, np.newaxis] * np.arange(laps.shape[1])
    cut = np.minimum.accumulate(laps - growth, 1) + growth
    last_lap: Floats = cut[:, -limits.shape[1] :]
    return last_lap


def effects_of(models: Floats) -> Floats:
    """Return the matrices from the present state and ten commands to the states x_1 to x_10.

    Each model is a row a11, …, b2.
    """
    matrix = models[:, :4].reshape(-1, 2, 2)
    by_command = models[:, 4:]
    state = np.tile(np.eye(2, 12), (len(models), 1, 1))
    states = []
    for k in range(10):
        state = matrix @ state
        state[:, :, 2 + k] += by_command
        states.append(state)
    return np.stack(states, 1)


LAW = read_law(
    'raceline.txt',
    {'curvature': _L.curvature, 'passed': passed, 'effects_of': effects_of},
    L_F=L_F,
    L_R=L_R,
    LAP=_L.length,
    POINTS=POINTS,
)
FUNCTIONS = Functions(
    LAW,
    results={name: (name,) for name in ('profile', 'predict', 'program')},
    criteria={'profile': 'speed.profile', 'predict': 'mpc.model', 'program': 'mpc.program'},
    count=10,
    agree=partial(np.allclose, rtol=_TOLERANCE, atol=_TOLERANCE),
    min_loss=0.6,
    calls={'program': 'predict'},
)


@cache
def _best(track: Track) -> Track:
    """Return the line of a track that bends least."""
    return racing_line(track)


class _StudentLine:
    """A student's line of a track, its offsets cut to their bounds."""

    def __init__(self, code: JudgedCode, track: Track) -> None:
        """Call the student's `line` for this track."""
        arguments = line_arguments(track)
        half = arguments[-1]
        offsets = np.array(code.rows('line', [arguments])[0])
        self.track = track
        self.excess = float(np.abs(offsets).max()) - half  #: [m] of the largest offset
        self._offsets = np.clip(offsets, -half, half)

    @cached_property
    def line(self) -> Track:
        """The line as a track; a UserError where no car can follow it."""
        return line_along(self.track, self._offsets.tolist())

    def judge_bending(self) -> tuple[float, str]:
        """Judge how much the line bends; return score and message."""
        best = bending(_best(self.track))
        centre = bending(self.track)
        bends = bending(self.line)
        score = share(bends, _BENT * best, centre)

        text = f'the integral of the squared curvature is {bends:.3g} 1/m '
        text += f'({centre:.3g} on the centre line, {best:.3g} on the best line)'
        if score < 1.0:
            k = int(np.abs(self.line.curvatures).argmax())
            radius = 1.0 / abs(self.line.curvatures[k])
            point = k // 2 + 1
            text += f'; it bends most at point {point} of {POINTS}, with a radius of {radius:.1f} m'

        mirrored = inf
        with suppress(UserError):  # no car can follow some mirror images
            mirrored = bending(line_along(self.track, (-self._offsets).tolist()))
        if share(mirrored, _BENT * best, centre) > score + 0.3:
            text = f'with the opposite sign it bends less: positive is to the left; {text}'
        return score, text

    def judge_laps(self) -> tuple[float, str, Evidence]:
        """Judge laps at the speed that the line allows; return score, message and evidence."""
        speed = speed_profile(self.line, *LIMITS)
        log = lap(LaneLQR(), self.line, speed=speed, laps=2, dynamics='dynamic')
        evidence = self._evidence(log)
        if log.s[-1] < 2.0 * self.line.length:
            text = f'the car leaves the track after {log.s[-1]:.0f} m along the line'
            return 0.0, text, evidence

        lateral = float(np.abs(log.v_x * log.psi_dot).max())
        planned = lap_time(self.line, LIMITS)
        text = f'lateral acceleration up to {lateral:.2f} m/s² (full marks up to '
        text += f'{_LOAD[0] * LIMITS[1]:.2f}); best lap {log.best:.2f} s, planned {planned:.2f} s '
        text += '(not judged)'
        return share(lateral / LIMITS[1], *_LOAD), text, evidence

    def _evidence(self, log: TrackLog) -> Evidence:
        """Return the planned laps of centre line, student's line and best line, and the drive."""
        rows = []
        lines = {'centre': self.track, 'yours': self.line, 'best': _best(self.track)}
        for name, line in lines.items():
            row = (
                name,
                f'{line.length:.1f} m',
                f'{bending(line):.3g} 1/m',
                f'{lap_time(line, LIMITS):.2f} s',
                f'{log.best:.2f} s' if name == 'yours' and log.best < inf else '',
            )
            rows.append(row)
        header = ('line', 'length', 'bending', 'planned lap', 'driven')
        return Evidence(f'{self.track.name}, line by line', header, rows, self._figure)

    def _figure(self, title: str = '') -> Figure:
        """Draw the line between the edges, and its speed."""
        from barc_sim.figures.track_figure import line_figure  # noqa: PLC0415 (slow)

        return line_figure(self.track, self.line, LIMITS, title)


def _judge(code: JudgedCode, settings: Settings) -> Iterator[Finding]:
    """Yield a finding for each criterion.

    Those of the line come last, because an error in `line` costs all that follow.
    """
    findings, _ = FUNCTIONS.judge(code, settings.seed, settings.points)
    yield from findings

    line = _StudentLine(code, _L)
    if line.excess > _TOLERANCE:
        text = f'an offset is {line.excess:.3g} m beyond its bounds; below, all are cut to them'
        yield Finding('line.inside', 0.0, text)
    else:
        yield Finding('line.inside', 1.0, 'no offset is beyond its bounds')

    score, text = line.judge_bending()
    yield Finding('line.bending', score, text)
    score, text, evidence = line.judge_laps()
    yield Finding('line.lap', score, text, evidence)

    hidden_line = _StudentLine(code, hidden_track(settings.seed))
    score, text = hidden_line.judge_bending()
    lap_score, lap_text, _ = hidden_line.judge_laps()
    yield Finding('line.hidden', min(score, lap_score), f'{text}; {lap_text}')


RACELINE = Lab(
    files.RACELINE,
    {'raceline': JudgedPart(LABELS, _judge)},
    by_eye={'line.gain': 'the figure, and two sentences'},
    check_packages=solver,
)
