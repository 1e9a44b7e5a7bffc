"""The run that is driven by hand: from the keyboard, or by another publisher of `cmd_vel`."""

from __future__ import annotations

import sys
from contextlib import nullcontext
from typing import TYPE_CHECKING

from barc_sim.control.keyboard import open_terminal
from barc_sim.control.relay import PEDAL
from barc_sim.errors import UserError
from barc_sim.lab.user_code.adapters import UserDriver
from barc_sim.lab.user_code.relay_program import ROS_2, RelayProgram
from barc_sim.runs.composition import Run, check_left_out, given
from barc_sim.runs.conduct import conduct
from barc_sim.runs.program import Program
from barc_sim.runs.terminal.display import DriveStatus, display
from barc_sim.vehicle.bike_model import bikeFE
from barc_sim.vehicle.road import Road

if TYPE_CHECKING:
    from argparse import Namespace

    from barc_sim.cli.signals import StopSignals
    from barc_sim.control.driver import Driver
    from barc_sim.control.keyboard import Terminal
    from barc_sim.nodes.simulator import VehicleSimulator
    from barc_sim.page.run_page import RunPage
    from barc_sim.runs.composition import Setup
    from barc_sim.vehicle.plant import Observation

#: [s] without a command after which the car brakes: ten of the relay's periods.
_COMMAND_TIMEOUT = 0.5
_HELP = 'arrows or WASD {drive}, space brakes, r goes back to the start, q ends'
_DRIVE = {'pedal': 'drive', 'velocity': 'ask for 1 m/s and 1 rad/s while held'}


def teleop(options: Namespace, stop: StopSignals) -> int:
    """Drive until the driver or `stop` ends it; return the exit code.

    Raises
    ------
    UserError
        if an option or a ROS argument cannot be used; no bag is left then.
    """
    terminal = _terminal()
    with terminal or nullcontext():
        return conduct(lambda setup: Teleop(setup, terminal), options, stop)


def _terminal() -> Terminal | None:
    """Return the terminal; None, with a sentence, where its keys cannot be read."""
    try:
        return open_terminal()
    except UserError as error:
        print(error, file=sys.stderr)  # noqa: T201
    return None


class Teleop(Run):
    """The run with a simulator on the flat, the relay and, if there is a terminal, the keyboard."""

    _process: Program | None = None

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

    def compose(self, setup: Setup) -> list[VehicleSimulator]:
        """Return the simulator."""
        options, road = setup.options, setup.road or Road.flat()
        self.display = display(quiet=options.quiet)
        self._program: RelayProgram | None = None  # to be run in a process of its own
        self._death = ''  # of that process, in a sentence
        self._driver = self._add_relay(setup)
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
        return [simulator]  # type: ignore[list-item]

    def _add_relay(self, setup: Setup) -> Driver | None:
        """Add the node `relay`, and return its driver; None where another process is the relay."""
        options, user_relay = setup.options, setup.user_code.relay
        if options.no_relay:
            check_left_out('relay', {'relay': options.relay, 'input': options.input})
            return None
        if options.input and user_relay:
            raise UserError(
                f"--input {options.input} is for barc_sim's relay, and --lab or --relay gives "
                'another: give one of the two only'
            )
        if isinstance(user_relay, RelayProgram) and user_relay.ros == ROS_2 and setup.engine.open:
            self._program = user_relay
            return None
        driver = UserDriver(user_relay) if user_relay else None
        return setup.engine.relay(driver, given(input=options.input)).driver

    def spin(self, stop: StopSignals) -> None:
        """Spin until the run is finished, its relay's process has ended, or `stop` is requested.

        Raises
        ------
        UserError
            if the relay's process has ended.
        """
        if self._program:
            show, file = self.setup.output, self._program.path
            self._process = Program(f'the relay {file.name}', file, show, self._on_death)
        super().spin(stop)
        if self._death:
            raise UserError(self._death)

    def close(self, *, keep_page: bool = False) -> RunPage | None:
        """End the nodes, with the results in the bag, and then the relay's process."""
        page = super().close(keep_page=keep_page)
        self._end_process()
        return page

    def discard(self) -> None:
        """End the nodes and the relay's process, and delete the bag."""
        super().discard()
        self._end_process()

    def _end_process(self) -> None:
        if self._process:
            self._process.close()

    def _on_death(self, sentence: str) -> None:
        self._death = sentence
        self.finish()

    def _on_step(self, t: float, seen: Observation) -> None:
        request = self._driver.request if self._driver else None
        true, servo = seen.true, seen.acting.servo
        self.display.show(DriveStatus(t, true.x, true.v_x, servo, request))

    def finish(self) -> None:
        """Restore the terminal, and end the run now."""
        if self._terminal:
            self._terminal.close()
        super().finish()

    def print_result(self) -> None:
        """Print how many deadlines were missed and periods slipped."""
        (simulator,) = self.simulators
        print(f'missed deadlines {simulator.stepper.missed}, clock slips {self.slipped}')  # noqa: T201
