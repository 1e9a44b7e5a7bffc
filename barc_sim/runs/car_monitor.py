"""Watches a car of the cruise-control run: its laps, its progress, its line in the terminal."""

from __future__ import annotations

from math import inf, nan
from typing import TYPE_CHECKING

from barc_sim.control.speed import SPEED_REFERENCE
from barc_sim.lab.user_code.adapters import COMMANDS
from barc_sim.runs.terminal import Display, cruise_line, track_line
from barc_sim.simulation.closed_loop import Progress
from barc_sim.simulation.metrics import Laps, TrackLaps

if TYPE_CHECKING:
    from barc_sim.nodes.controller import CruiseController
    from barc_sim.nodes.simulator import VehicleSimulator
    from barc_sim.runs.composition import Run
    from barc_sim.simulation.metrics import Summary
    from barc_sim.vehicle.plant import Observation


class CarMonitor:
    """Adds the states of a simulator to laps, and ends the run of a car without progress."""

    def __init__(
        self, run: Run, name: str, controller: CruiseController | None, simulator: VehicleSimulator
    ) -> None:
        """Watch from now on; `name` is empty for a single car."""
        self.name = name
        self.controller = controller
        self.simulator = simulator
        self.display: Display | None = None  #: shows the car, if it is set

        speed = run.options.speed
        self._speed = SPEED_REFERENCE if speed is None else speed
        self._duration = COMMANDS if run.inputs.user_code.identify else inf

        self._laps = Laps()
        self.track_laps = TrackLaps()
        self._progress = Progress(inf)
        simulator.on_step = self.on_step

    def on_step(self, t: float, observation: Observation) -> None:
        """Add the state, `t` [s] after the start of its lap, to the lap, and show it.

        If the car makes no progress, the run ends.
        """
        place = observation.on_track
        distance = place.s if place else observation.true.x
        reference = self._reference(t, observation)
        if t == 0.0:
            self._progress = Progress(self.simulator.stepper.distance)

        self._add_to_lap(t, observation, reference)
        is_stuck = self._progress.add(t, distance, observation.true.v_x, reference, place)
        if is_stuck or t >= self._duration:
            self.simulator.stepper.end()
        if self.display:
            self.display.show(distance, lambda: self._line(t, observation, reference))

    def _reference(self, t: float, observation: Observation) -> float:
        """Return the speed to hold [m/s]; without a controller, that of the command line."""
        if not self.controller:
            return self._speed
        distance = observation.on_track.s if observation.on_track else observation.measured.x
        return self.controller.reference(t, distance)

    def _add_to_lap(self, t: float, observation: Observation, reference: float) -> None:
        place = observation.on_track
        if place is None:
            car = observation.true
            self._laps.add(t, car.x, car.y, car.v_x, reference, observation.surroundings.theta)
            return

        # The command that made this state, which is not answered yet.
        lane = self.controller.lane if self.controller else None
        servo = lane.output if lane else 0.0
        self.track_laps.add(t, place.lap, place.lap_time, place.e_y, servo)

    def _line(self, t: float, observation: Observation, reference: float) -> str:
        """Return the line of a state, which is the last one that was added."""
        speed = observation.true.v_x
        if observation.on_track:
            return track_line(t, observation.on_track, speed)
        has_reference = self._duration == inf  # the commands of `identify.py` hold no speed
        error = reference - speed if has_reference else nan
        return cruise_line(
            t, observation.true.x, speed, error, observation.surroundings.theta, self._laps.number
        )

    @property
    def failure(self) -> str:
        """Why the car will never arrive, with its name; empty if it can."""
        failure = self._progress.failure
        return f'{self.name}: {failure}' if self.name and failure else failure

    def summaries(self) -> dict[str, Summary]:
        """Return the summary of each lap's speed errors, by the name of the car, or of the lap."""
        laps = [*self._laps]
        if self.name and len(laps) == 1:
            return {self.name: laps[0].summary}

        summaries: dict[str, Summary] = {}
        for lap in laps:
            name = f'{lap.number + 1:3d}  {lap.start_distance:5.1f} to {lap.end_distance:5.1f} m'
            summaries[f'{self.name} {name}' if self.name else name] = lap.summary
        return summaries
