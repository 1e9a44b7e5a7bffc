"""The run by hand: the driver uses the keyboard, the page, or another publisher of `cmd_vel`."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from contextlib import contextmanager, nullcontext, suppress
from threading import Event, Thread
from typing import TYPE_CHECKING

from barc_sim.control.keyboard import Terminal
from barc_sim.errors import UserError
from barc_sim.lab.user_code.adapters import UserDriver
from barc_sim.nodes.keyboard import Keyboard
from barc_sim.nodes.relay import Relay
from barc_sim.runs.composition import Run
from barc_sim.runs.engine import start_engine
from barc_sim.runs.report import late, print_line, print_report
from barc_sim.runs.terminal import Display, drive_line
from barc_sim.runs.views import add_views
from barc_sim.vehicle.road import Road

if TYPE_CHECKING:
    from argparse import Namespace
    from collections.abc import Iterator

    from barc_sim.cli.process import StopSignals
    from barc_sim.nodes.simulator import VehicleSimulator
    from barc_sim.runs.inputs import RunInputs
    from barc_sim.vehicle.plant import Observation

#: [s] without a command after which the car brakes: ten of the relay's periods.
_COMMAND_TIMEOUT = 0.5
_EXIT_TIMEOUT = 2.0  #: [s] for the process of a relay to end by itself
_HELP = 'arrows or WASD (ZQSD) drive, space brakes, r goes back to the start, q ends (ZQSD: Ctrl-C)'


def run_nodes(options: Namespace, inputs: RunInputs, stop: StopSignals) -> int:
    """Run the nodes until the driver or `stop` ends it; return the exit code.

    UserError: an option or a ROS argument cannot be used; no bag is left then.
    """
    terminal = _terminal()
    with (
        terminal or nullcontext(),
        start_engine(options) as carrier,
        _relay_program(options, inputs) as program,
        Run(options, inputs, carrier) as run,
    ):
        relay = None if options.no_relay or program else _add_relay(run)
        simulator = _add_simulator(run)
        if terminal:
            _add_keyboard(run, terminal, simulator)

        if not options.quiet:
            run.display = Display()
            simulator.on_step = LiveLine(run.display, relay).show
        print_line(options, f'engine     {carrier.name}')
        add_views(run)

        run.prepare()
        stop.then(run.finish)
        if terminal:
            print_line(options, _HELP)

        if program:
            Thread(target=_follow, args=(program, run), daemon=True).start()
        with carrier.new_executor() as executor:
            for node in run.nodes:
                executor.add_node(node)
            executor.spin_until_future_complete(run.finished)
            run.await_readers(executor)

        if program and program.poll() is not None:
            name = inputs.user_code.relay.path.name
            raise UserError(f'the relay {name} has ended with exit code {program.returncode}')
    return print_report(run, lambda: print(late(run)))  # noqa: T201


def _add_relay(run: Run) -> Relay:
    user_code = run.inputs.user_code
    relay: Relay = run.add(Relay, driver=UserDriver(user_code) if user_code.relay else None)
    return relay


def _add_simulator(run: Run) -> VehicleSimulator:
    road = run.inputs.road or Road.flat()
    parameters = {'road': road.name, 'command_timeout': _COMMAND_TIMEOUT}
    simulator = run.add_simulator(parameters, road=road)
    if simulator.values['realtime_factor'] == 0.0:
        raise UserError(
            'nobody can drive at full speed (max): give teleop a --realtime-factor above 0'
        )
    return simulator


def _add_keyboard(run: Run, terminal: Terminal, simulator: VehicleSimulator) -> None:
    """Add the keyboard, which ends the run; the end of the run gives back the terminal."""
    keyboard = run.add(Keyboard, terminal=terminal)
    keyboard.finished.add_done_callback(lambda _: run.finish())
    simulator.finished.add_done_callback(lambda _: terminal.close())


@contextmanager
def _relay_program(options: Namespace, inputs: RunInputs) -> Iterator[subprocess.Popen[str] | None]:
    """With ROS, run a relay that is a program of rclpy in a process, which ends with the block.

    It gets the run's arguments after `--ros-args`, and so its namespace.
    """
    relay = inputs.user_code.relay
    if options.engine != 'ros' or getattr(relay, 'ros', '') != 'rclpy':
        yield None
        return

    file = relay.path.resolve()
    is_over = Event()
    # In a session of its own: a Ctrl-C ends the run, which then ends this process.
    program = subprocess.Popen(  # noqa: S603 (the user's own file)
        [sys.executable, '-u', str(file), *options.ros_args],
        cwd=file.parent,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        encoding='utf-8',
        errors='replace',
        start_new_session=True,
    )
    output = Thread(target=_print_output, args=(program, is_over), daemon=True)
    output.start()

    try:
        yield program
    finally:
        if program.poll() is None:
            is_over.set()  # most programs answer SIGINT with a traceback
            program.send_signal(signal.SIGINT)
        with suppress(subprocess.TimeoutExpired):
            program.wait(_EXIT_TIMEOUT)
        with suppress(OSError):  # it and its child processes may have ended
            os.killpg(program.pid, signal.SIGKILL)
        program.wait()
        output.join(_EXIT_TIMEOUT)


def _print_output(program: subprocess.Popen[str], is_over: Event) -> None:
    """Print a program's output on stderr, above the live line, until the run is over."""
    with program.stdout or nullcontext(()) as lines:
        for line in lines:
            if not is_over.is_set():
                print(line, end='', file=sys.stderr, flush=True)  # noqa: T201


def _follow(program: subprocess.Popen[str], run: Run) -> None:
    """End the run when the process of its relay ends."""
    program.wait()
    run.finish()


def _terminal() -> Terminal | None:
    """Return the terminal; if its keys cannot be read, print why and return None."""
    try:
        return Terminal()
    except UserError as error:
        print(error, file=sys.stderr)  # noqa: T201
    return None


class LiveLine:
    """Shows the states in the terminal, with the driver's input if there is a relay."""

    def __init__(self, display: Display, relay: Relay | None) -> None:
        """Show in `display`."""
        self._display = display
        self._relay = relay

    def show(self, t: float, observation: Observation) -> None:
        """Show the state at `t` [s]."""
        request = self._relay.driver.request if self._relay else None
        speed = observation.true.v_x
        steering = observation.acting.servo
        self._display.show(observation.true.x, lambda: drive_line(t, speed, steering, request))
