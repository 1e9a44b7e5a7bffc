"""The run that is driven by hand: from the keyboard, or by another publisher of `cmd_vel`."""

from __future__ import annotations

import sys
from contextlib import nullcontext
from typing import TYPE_CHECKING

from barc_sim.control.keyboard.console import open_terminal
from barc_sim.control.relay import PEDAL
from barc_sim.errors import UserError
from barc_sim.lab.user_code.adapters import UserDriver
from barc_sim.runs.composition import Run, given
from barc_sim.runs.conduct import conduct
from barc_sim.runs.terminal.display import DriveStatus, display
from barc_sim.vehicle.bike_model import bikeFE
from barc_sim.vehicle.road import Road

if TYPE_CHECKING:
    from argparse import Namespace

    from barc_sim.cli.signals import StopSignals
    from barc_sim.control.keyboard.terminal import Terminal
    from barc_sim.runs.composition import Setup
    from barc_sim.runs.engine import Simulator
    from barc_sim.vehicle.plant import Observation

#: [s] without a command after which the car brakes: ten of the relay's periods.
_COMMAND_TIMEOUT = 0.5
_HELP = 'arrows or WASD {drive}, space brakes, r goes back to the start, q ends'
_DRIVE = {'pedal': 'drive', 'velocity': 'ask for 1 m/s and 1 rad/s while held'}


def teleop(options: Namespace, argv: list[str], ros_args: list[str], stop: StopSignals) -> int:
    """Drive until the driver or `stop` ends it; return the exit code.

    Raises
    ------
    UserError
        if an option or a ROS argument cannot be used; no bag is left then.
    """
    terminal = _terminal()
    with terminal or nullcontext():
        return conduct(lambda setup: Teleop(setup, terminal), options, argv, ros_args, stop)


def _terminal() -> Terminal | None:
    """Return the terminal; None, with a sentence, where its keys cannot be read."""
    try:
        return open_terminal()
    except UserError as error:
        print(error, file=sys.stderr)  # noqa: T201
    return None


class Teleop(Run):
    """The run with a simulator on the flat, the relay and, if there is a terminal, the keyboard."""

    def __init__(self, setup: Setup, terminal: Terminal | None) -> None:
        """Create the nodes; the terminal, if any, is closed at the end.

        Raises
        ------
        UserError
            if a parameter or the topic cannot be had; no bag is left then.
        """
        self._terminal = terminal
        super().__init__(setup)
        if terminal and not setup.options.quiet:
            print(_HELP.format(drive=_DRIVE[setup.options.input or PEDAL]))  # noqa: T201

    def compose(self, setup: Setup) -> list[Simulator]:
        """Return the simulator."""
        options, road = setup.options, setup.road or Road.flat()
        self.display = display(quiet=options.quiet)
        user_relay = setup.user_code.relay
        self._relay = setup.engine.relay(
            UserDriver(user_relay) if user_relay else None, given(input=options.input)
        )
        simulator = setup.engine.simulator(
            road=road,
            on_step=self._on_step,
            model=setup.user_code.model or bikeFE,
            given=given(
                road=road.name,
                realtime_factor=options.realtime_factor,
                seed=options.seed,
                integrator=options.integrator,
                dynamics=options.dynamics,
                clock=options.clock,
                command_timeout=_COMMAND_TIMEOUT,
            ),
        )
        if simulator.values['realtime_factor'] == 0.0:
            raise UserError(
                "a driver's time cannot run as fast as it goes: give teleop a --realtime-factor "
                'above 0'
            )
        if self._terminal:
            setup.engine.keyboard(self._terminal)
        return [simulator]

    def _on_step(self, t: float, seen: Observation) -> None:
        driver = self._relay.driver
        self.display.show(DriveStatus(t, seen.true.x, seen.true.v_x, driver.servo, driver.request))

    def finish(self) -> None:
        """Restore the terminal, and end the run now."""
        if self._terminal:
            self._terminal.close()
        super().finish()

    def print_result(self) -> None:
        """Print how many deadlines were missed and periods slipped."""
        (simulator,) = self.simulators
        print(f'missed deadlines {simulator.missed}, clock slips {self.slipped}')  # noqa: T201
