"""What a car of a cruise-control run has driven: its laps, its live line, its end."""

from __future__ import annotations

from functools import partial
from math import inf, nan
from typing import TYPE_CHECKING

from barc_sim.control.speed import KD, KI, KP, NO_LIMIT, PID, SPEED_REFERENCE
from barc_sim.lab.user_code.adapters import COMMANDS
from barc_sim.runs.inputs import gains
from barc_sim.runs.terminal import (
    cruise_line,
    print_summaries,
    print_summary,
    print_track_laps,
    track_line,
)
from barc_sim.simulation.closed_loop import Progress
from barc_sim.simulation.metrics import Laps, TrackLaps

if TYPE_CHECKING:
    from argparse import Namespace

    from barc_sim.lab.user_code.code import UserCode
    from barc_sim.nodes.controller import CruiseController
    from barc_sim.nodes.simulator import VehicleSimulator
    from barc_sim.runs.composition import Run
    from barc_sim.runs.terminal import Display
    from barc_sim.simulation.metrics import Summary
    from barc_sim.vehicle.plant import Observation, TrackState


class Car:
    """Watches a simulator: adds its states to laps, and ends the run of a car without progress."""

    def __init__(
        self,
        run: Run,
        name: str,
        controller: CruiseController | None,
        simulator: VehicleSimulator,
    ) -> None:
        """Watch from now on; `name` is empty for a car alone."""
        options = run.options
        self.name, self.controller, self.simulator = name, controller, simulator
        self.display: Display | None = None
        self._laps, self.track_laps = Laps(), TrackLaps()
        self._progress, self._off = Progress(inf), ''
        self._duration = COMMANDS if run.inputs.user_code.identify else inf
        self._speed = SPEED_REFERENCE if options.speed is None else options.speed
        simulator.on_step = self.on_step

    def on_step(self, t: float, seen: Observation) -> None:
        """Add the state, `t` [s] after the start of its lap, to the lap, and show it.

        The run of a car that makes no progress ends.
        """
        if t == 0.0:
            self._progress, self._off = Progress(self.simulator.stepper.distance), ''
        x, y, speed, reference = seen.true.x, seen.true.y, seen.true.v_x, self._speed
        place, measured = seen.on_track, seen.measured.x
        if place:
            x, y = measured, _ = place.s, place.e_y
        if self.controller:
            reference = self.controller.reference(t, measured)
        theta_deg = seen.surroundings.theta
        lap = self._laps.add(t, x, y, speed, reference, theta_deg)
        if self._progress.add(t, x, speed, reference) or t >= self._duration:
            self.simulator.stepper.end()
        if place:
            self._add_place(t, place)
        if not self.display:
            return
        if place:
            self.display.show(x, partial(track_line, t, place, speed))
        else:
            error = nan if self._duration < inf else reference - speed  # of commands alone: none
            self.display.show(x, partial(cruise_line, t, x, speed, error, theta_deg, lap))

    def _add_place(self, t: float, place: TrackState) -> None:
        """Add the place to the laps of the track; the run of a car beyond its edge ends."""
        # The command that made this state, which is not answered yet.
        servo = self.controller.lane.output if self.controller and self.controller.lane else 0.0
        self.track_laps.add(t, place.lap, place.lap_time, place.e_y, servo)
        track = self.simulator.track
        if track and abs(place.e_y) > 0.5 * track.width:
            side = 'left' if place.e_y > 0.0 else 'right'
            self._off = f'the car left the track to the {side} at {place.s:.1f} m'
            self.simulator.stepper.end()

    @property
    def failure(self) -> str:
        """What a car does that never arrives, with its name; empty for others."""
        failure = self._progress.failure or self._off
        return f'{self.name}: {failure}' if self.name and failure else failure

    def summaries(self) -> dict[str, Summary]:
        """Return the summary of each lap's speed errors, by the name of the car, or of the lap."""
        laps, named = [*self._laps], {}
        for lap in laps:
            name = f'{lap.number + 1:3d}  {lap.start_distance:5.1f} to {lap.end_distance:5.1f} m'
            if self.name:
                name = self.name if len(laps) == 1 else f'{self.name} {name}'
            named[name] = lap.summary
        return named


def print_result(run: Run, cars: list[Car]) -> None:
    """Print the table of speed errors, and what a user's code drove with."""
    user_code, controller = run.inputs.user_code, cars[0].controller
    if user_code.controller and controller:
        print(f'controller  {_driven_with(run.options, user_code, controller)}')  # noqa: T201
    if user_code.tolerated:
        print(f'tolerated   {"; ".join(user_code.tolerated)}')  # noqa: T201
    if user_code.identify:
        return  # its commands hold no speed
    summaries = {name: lap for car in cars for name, lap in car.summaries().items()}
    missed = sum(car.simulator.stepper.missed for car in cars)
    late = f'missed deadlines {missed}, clock slips {run.slipped}'
    if cars[0].simulator.track:
        print_track_laps({car.name: car.track_laps for car in cars}, late)
    elif len(summaries) > 1:
        print_summaries('car' if len(cars) > 1 else 'lap', summaries, late)
    else:
        print_summary(next(iter(summaries.values())), late)


def _driven_with(options: Namespace, user_code: UserCode, controller: CruiseController) -> str:
    """Return the gains and the limit of a user's controller."""
    from barc_sim.lab.files import ChosenGains  # noqa: PLC0415 (slow)

    chosen, named = user_code.gains or ChosenGains(KP, KI, KD, 'barc_sim'), gains(options)
    if named:
        rest = '' if len(named) == len(PID.gains) else f', the others from {chosen.origin}'
        chosen = chosen._replace(**named, origin=f'the command line{rest}')
    limit = controller.values['acceleration_limit']
    limited = 'without a limit' if limit >= NO_LIMIT else f'limited to {limit:g} m/s²'
    return f'{chosen}, {limited}'
