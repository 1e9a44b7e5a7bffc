"""The run that is driven by hand: from the keyboard, or by another publisher of `cmd_vel`."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
from contextlib import ExitStack, contextmanager, nullcontext, suppress
from functools import partial
from typing import TYPE_CHECKING

from barc_sim.control.driver import PEDAL
from barc_sim.control.keyboard import Terminal
from barc_sim.errors import UserError
from barc_sim.lab.user_code.adapters import UserDriver
from barc_sim.lab.user_code.folder import UserFunction
from barc_sim.nodes.keyboard import Keyboard
from barc_sim.nodes.relay import Relay
from barc_sim.runs.composition import Run, carrier, check_left_out, read_inputs
from barc_sim.runs.terminal import Display, drive_line
from barc_sim.vehicle.road import Road

if TYPE_CHECKING:
    from argparse import Namespace
    from collections.abc import Callable, Iterator
    from pathlib import Path

    from barc_sim.cli.process import StopSignals
    from barc_sim.lab.user_code.code import UserCode
    from barc_sim.nodes.simulator import VehicleSimulator
    from barc_sim.vehicle.plant import Observation

#: [s] without a command after which the car brakes: ten of the relay's periods.
_COMMAND_TIMEOUT = 0.5
#: Replaces itself by the command after it, which ends with this process, however that ends.
_START = (
    'import ctypes, os, signal, sys\n'
    'set_death_signal = 1\n'
    'ctypes.CDLL(None).prctl(set_death_signal, signal.SIGKILL)\n'
    'os.execv(sys.argv[1], sys.argv[1:])\n'
)
_LAST_WORDS = 2.0  #: [s] for the relay's process to end by itself after a signal
_SHOWN = 200  #: characters of its last line
_HELP = 'arrows or WASD {drive}, space brakes, r goes back to the start, q ends'
_DRIVE = {'pedal': 'drive', 'velocity': 'ask for 1 m/s and 1 rad/s while held'}


def drive(options: Namespace, stop: StopSignals) -> int:
    """Drive until the driver or `stop` ends it; return the exit code.

    UserError: an option or a ROS argument cannot be used; no bag is left then.
    """
    inputs = read_inputs(options)
    _check(options, inputs.user_code.relay)
    road, line = inputs.road or Road.flat(), None if options.quiet else Display()
    terminal = _terminal()
    with (
        terminal or nullcontext(),
        carrier(options) as new_executor,
        ExitStack() as after,
        Run(options, inputs, stop) as run,
    ):
        program = _program(options, inputs.user_code)
        relay: Relay | None = None
        if not (options.no_relay or program):
            driver = UserDriver(inputs.user_code) if inputs.user_code.relay else None
            relay = run.add(Relay, {'input': options.input}, driver=driver)
        simulator = run.add_simulator(
            {'road': road.name, 'command_timeout': _COMMAND_TIMEOUT},
            road=road,
            on_step=partial(_show, line, relay) if line else None,
        )
        _check_pace(simulator)
        if terminal:
            keyboard = run.add(partial(Keyboard, terminal))
            keyboard.finished.add_done_callback(lambda _: run.finish())
            simulator.finished.add_done_callback(lambda _: terminal.close())
        run.show(line)
        if terminal and not options.quiet:
            print(_HELP.format(drive=_DRIVE[options.input or PEDAL]))  # noqa: T201

        # It ends after the nodes, so that the bag's graph has it.
        check = after.enter_context(_process(program, run)) if program else None
        with new_executor() as executor:
            run.spin(executor)
        if check:
            check()
    return run.end(lambda: _print_result(run))


def _terminal() -> Terminal | None:
    """Return the terminal; None, with a sentence, where its keys cannot be read."""
    try:
        return Terminal()
    except UserError as error:
        print(error, file=sys.stderr)  # noqa: T201
    return None


def _check(options: Namespace, user_relay: object) -> None:
    """Refuse options that contradict one another."""
    if options.no_relay:
        check_left_out('relay', {'relay': options.relay, 'input': options.input})
    elif options.input and user_relay:
        raise UserError(
            f"--input {options.input} is for barc_sim's relay, and --lab or --relay gives another: "
            'give one of the two only'
        )


def _program(options: Namespace, user_code: UserCode) -> Path | None:
    """Return a relay that is to run in a process of its own, where DDS reaches it."""
    relay = user_code.relay
    if options.engine != 'ros' or relay is None or isinstance(relay, UserFunction):
        return None
    return relay.path if relay.ros == 'rclpy' else None


@contextmanager
def _process(file: Path, run: Run) -> Iterator[Callable[[], None]]:
    """Run a student's relay with this Python, in the same ROS domain, until the block ends.

    What it prints is shown line by line. The run ends with it; give what raises UserError then.
    """
    process = subprocess.Popen(  # noqa: S603 (the user's own file)
        [sys.executable, '-c', _START, sys.executable, '-u', str(file.resolve())],
        cwd=file.resolve().parent,
        env=os.environ | {'PYTHONIOENCODING': 'utf-8'},
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        encoding='utf-8',
        errors='replace',
        # A Ctrl-C ends the run, which then ends this process.
        start_new_session=True,
    )
    last, is_over = '', threading.Event()

    def follow() -> None:
        nonlocal last
        for line in process.stdout or ():
            last = line.strip() or last
            if not is_over.is_set():
                run.inputs.output(line)
        process.wait()
        run.finish()

    def check() -> None:
        if (code := process.poll()) is not None:
            end = f'signal {-code}' if code < 0 else f'exit code {code}'
            why = f': {last[:_SHOWN]}' if last and code else ''
            raise UserError(f'the relay {file.name} has ended with {end}{why}')

    thread = threading.Thread(target=follow, name='relay', daemon=True)
    thread.start()
    try:
        yield check
    finally:
        is_over.set()
        for number in (signal.SIGINT, signal.SIGKILL):
            if process.poll() is None:
                process.send_signal(number)
                with suppress(subprocess.TimeoutExpired):
                    process.wait(_LAST_WORDS)
        thread.join(_LAST_WORDS)


def _check_pace(simulator: VehicleSimulator) -> None:
    if simulator.values['realtime_factor'] == 0.0:
        raise UserError(
            "a driver's time cannot run as fast as it goes: give teleop a --realtime-factor above 0"
        )


def _show(line: Display, relay: Relay | None, t: float, seen: Observation) -> None:
    """Show a state, with the driver's input where it is known."""
    request = relay.driver.request if relay else None
    line.show(seen.true.x, partial(drive_line, t, seen.true.v_x, seen.acting.servo, request))


def _print_result(run: Run) -> None:
    """Print how many deadlines were missed and periods slipped."""
    missed = sum(each.stepper.missed for each in run.simulators)
    print(f'missed deadlines {missed}, clock slips {run.slipped}')  # noqa: T201
