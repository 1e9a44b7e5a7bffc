"""The run driven by hand: keyboard, or another publisher of `cmd_vel`, and relay."""

from __future__ import annotations

import sys
from contextlib import nullcontext
from typing import TYPE_CHECKING

from barc_sim.errors import UserError
from barc_sim.lab.user_code.adapters import UserDriver
from barc_sim.nodes.keyboard.node import Keyboard
from barc_sim.nodes.keyboard.terminal import Terminal
from barc_sim.nodes.relay import Relay
from barc_sim.nodes.simulator.node import VehicleSimulator
from barc_sim.runs.composition import Run, conduct, overrides
from barc_sim.runs.terminal.status_line import Status, StatusLine
from barc_sim.vehicle.bike_model import bikeFE

if TYPE_CHECKING:
    from argparse import Namespace

    from barc_sim.cli.signals import StopSignals
    from barc_sim.lab.user_code.loading import UserCode
    from barc_sim.runs.terminal.printed import Printed
    from barc_sim.vehicle.plant import Observation

#: [s] Without a command for so long the car brakes: ten of the relay's periods.
_COMMAND_TIMEOUT = 0.5
_HELP = 'arrows or WASD drive, space brakes, r goes back to the start, q ends'


def teleop(options: Namespace, argv: list[str], ros_args: list[str], stop: StopSignals) -> int:
    """Drive until the driver or `stop` ends it; return the exit code.

    Raises
    ------
    UserError
        where an option or a ROS argument can't be used; nothing is left behind then.
    """
    terminal = None
    try:
        terminal = Terminal()
    except UserError as error:
        print(error, file=sys.stderr)  # noqa: T201
    with terminal or nullcontext():
        return conduct(
            lambda user_code, printed: Teleop(options, argv, user_code, printed, terminal),
            options,
            ros_args,
            stop,
        )


class Teleop(Run):
    """Recorder, simulator on the flat, relay and, where there is a terminal, keyboard."""

    def __init__(
        self,
        options: Namespace,
        argv: list[str],
        user_code: UserCode,
        printed: Printed,
        terminal: Terminal | None,
    ) -> None:
        """Make the nodes; the terminal, if any, is closed at the end.

        Raises
        ------
        UserError
            where a parameter or the topic can't be had; nothing is left behind then.
        """
        self._terminal = terminal
        self._line = StatusLine(quiet=options.quiet)
        printed.show_with(self._line.say)
        super().__init__(options, argv, user_code, printed)
        if terminal and not options.quiet:
            print(_HELP)  # noqa: T201

    def compose(self, options: Namespace) -> list[VehicleSimulator]:
        """Return the simulator."""
        simulator: VehicleSimulator = self.add(
            VehicleSimulator(
                on_step=self._on_step,
                model=self.user_code.model or bikeFE,
                parameter_overrides=overrides(
                    road=options.road or 'flat',
                    realtime_factor=options.realtime_factor,
                    seed=options.seed,
                    integrator=options.integrator,
                    dynamics=options.dynamics,
                    clock=options.clock,
                    command_timeout=_COMMAND_TIMEOUT,
                ),
            )
        )
        if simulator.get_parameter('realtime_factor').value == 0.0:
            raise UserError(
                "a driver's time cannot run as fast as it goes: give teleop a --realtime-factor "
                'above 0'
            )
        self._relay = self.add(
            Relay(driver=UserDriver(self.user_code.relay) if self.user_code.relay else None)
        )
        if self._terminal:
            keyboard = self.add(Keyboard(self._terminal))
            keyboard.finished.add_done_callback(lambda _: simulator.finish())
        return [simulator]

    def _on_step(self, t: float, seen: Observation) -> None:
        """Show the state now and then."""
        if self._line.is_due():
            driver = self._relay.driver
            self._line.show(Status(t, seen.true.v_x, driver.servo, driver.request))

    def finish(self) -> None:
        """Give the terminal back, and end the run now."""
        if self._terminal:
            self._terminal.close()
        super().finish()

    def close_display(self) -> None:
        """Leave the terminal's line in order."""
        self._line.close()

    def print_result(self) -> None:
        """Print what there is to say of the run's timing."""
        print(f'missed deadlines {self.missed}, clock slips {self.slipped}')  # noqa: T201
