"""The cruise-control run: the PID holds a speed over the hills."""

from __future__ import annotations

from typing import TYPE_CHECKING

from barc_sim.bike_model import bikeFE
from barc_sim.composition import Run, conduct, overrides
from barc_sim.console.display import display, print_summary
from barc_sim.metrics import SpeedErrors
from barc_sim.nodes.controller import CruiseController
from barc_sim.nodes.simulator import VehicleSimulator
from barc_sim.own_code import StudentPid

if TYPE_CHECKING:
    from argparse import Namespace

    from barc_sim.plant import Observation
    from barc_sim.signals import StopSignals

#: [m] The lab's road ends there.
_DISTANCE = 180.0


def cruise_control(
    options: Namespace, argv: list[str], ros_args: list[str], stop: StopSignals
) -> int:
    """Drive until the distance is reached or `stop` is requested; return the exit code.

    Raises
    ------
    UserError
        where an option or a ROS argument can't be used; nothing is left behind then.
    """
    return conduct(
        lambda lab, printed: CruiseControl(options, argv, lab, printed), options, ros_args, stop
    )


class CruiseControl(Run):
    """Recorder, controller and simulator."""

    def compose(self, options: Namespace) -> VehicleSimulator:
        """Return the simulator of the lab's road."""
        self._errors = SpeedErrors()
        self._controller = self.add(
            CruiseController(
                pid=StudentPid(self.lab.controller) if self.lab.controller else None,
                parameter_overrides=overrides(
                    speed_reference=options.speed, kp=options.kp, ki=options.ki, kd=options.kd
                ),
            )
        )
        simulator: VehicleSimulator = self.add(
            VehicleSimulator(
                distance=_DISTANCE,
                on_step=self.on_step,
                model=self.lab.model or bikeFE,
                parameter_overrides=overrides(
                    distance=options.distance,
                    road=options.road,
                    realtime_factor=options.realtime_factor,
                    seed=options.seed,
                    integrator=options.integrator,
                    dynamics=options.dynamics,
                    clock=options.clock,
                ),
            )
        )
        distance = simulator.get_parameter('distance').value
        self._display = display(distance, quiet=options.quiet)
        self._printed.show_with(self._display.say)
        return simulator

    def on_step(self, t: float, seen: Observation) -> None:
        """Count the speed's error, from the start or the latest reset on, and show it."""
        if t == 0.0:
            self._errors = SpeedErrors()
        reference = self._controller.speed_reference
        self._errors.add(t, seen.true.x, seen.true.v_x, reference, seen.theta_deg)
        self._display.show(t, seen.true.x, seen.true.v_x, reference - seen.true.v_x, seen.theta_deg)

    def close_display(self) -> None:
        """Leave the terminal's line in order."""
        self._display.close()

    def print_result(self) -> None:
        """Print the table of errors."""
        print_summary(self._errors.summary(self.missed), self.slipped)
