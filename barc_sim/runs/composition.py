"""Composes a run of an engine's nodes, and spins them to its end."""

from __future__ import annotations

import gc
import sys
from abc import ABC, abstractmethod
from typing import TYPE_CHECKING, NamedTuple

from barc_sim.errors import UserError
from barc_sim.runs.bag import RunBag

if TYPE_CHECKING:
    from argparse import Namespace
    from collections.abc import Mapping, Sequence

    from barc_sim.cli.signals import StopSignals
    from barc_sim.lab.user_code.loading import UserCode
    from barc_sim.nodes.simulator import VehicleSimulator
    from barc_sim.page.run_page import RunPage
    from barc_sim.runs.engine import Engine
    from barc_sim.runs.terminal.display import Display
    from barc_sim.runs.terminal.user_output import UserOutput
    from barc_sim.vehicle.road import Road

#: [s] A thread that runs Python code gives way to the one that steps the simulator after this
#: long; the default, 5 ms, is a quarter of a step.
_SWITCH_INTERVAL = 1e-4


class Setup(NamedTuple):
    """What a run is made of: the command line, and the values that it names."""

    options: Namespace
    road: Road | None  #: of `--road`; None: that of the simulator's parameter
    user_code: UserCode
    output: UserOutput  #: takes what user code prints
    engine: Engine  #: carries the messages


class Run(ABC):
    """The recorder, the simulator of each car, and the nodes that drive and show them."""

    display: Display  #: what the terminal shows; `compose` sets it

    def __init__(self, setup: Setup) -> None:
        """Create the nodes, the recorder first: it records what the others publish at their start.

        Raises
        ------
        UserError
            if a parameter or the topic cannot be had; no bag is left then.
        """
        options = setup.options
        self.setup = setup
        self.failure: str | None = None  #: the error that ended the run
        self._closed = False
        self._engine = engine = setup.engine
        self.bag = None if options.no_bag else RunBag(options, setup.user_code, engine)
        try:
            self.simulators = self.compose(setup)
            setup.output.show_with(self.display.print_line)
            if not options.quiet:
                print(f'engine     {engine.name}', flush=True)  # noqa: T201
            engine.show(options)
        except BaseException:
            self.discard()
            raise
        if self.bag:
            self.bag.begin(options.argv)

    @abstractmethod
    def compose(self, setup: Setup) -> Sequence[VehicleSimulator]:
        """Create the nodes and the display; return the simulators, one for each car."""

    @abstractmethod
    def print_result(self) -> None:
        """Print the results."""

    def spin(self, stop: StopSignals) -> None:
        """Spin until the run is finished or `stop` is requested."""
        # A full garbage collection takes half a step: exclude what lives as long as the run.
        gc.collect()
        gc.freeze()
        sys.setswitchinterval(_SWITCH_INTERVAL)
        stop.then(self.finish)
        try:
            self._engine.spin()
        finally:
            self.setup.output.close()
            self.display.close()

    def finish(self) -> None:
        """End the run now; may be called from any thread."""
        for simulator in self.simulators:
            simulator.finish()

    @property
    def has_begun(self) -> bool:
        """Whether a state has been published."""
        return any(simulator.stepper.states for simulator in self.simulators)

    @property
    def slipped(self) -> int:
        """Periods by which simulated time has fallen behind the wall clock, of all cars."""
        return sum(simulator.stepper.slipped for simulator in self.simulators)

    def fail(self, failure: str) -> None:
        """Keep the error that ended the run, also in the bag."""
        self.failure = failure
        if self.bag:
            self.bag.recorder.add_metadata({'failure': failure})

    def close(self, *, keep_page: bool = False) -> RunPage | None:
        """End the nodes, with the results in the bag; again, do nothing.

        With `keep_page`, the page stays open, and is returned if there is one.
        """
        if self.bag and not self._closed:
            self.bag.end(self.simulators)
        self._closed = True
        return self._engine.close(keep_page=keep_page)

    def discard(self) -> None:
        """End the nodes, and delete the bag."""
        self._closed = True
        self._engine.close()
        if self.bag:
            self.bag.discard()

    def print_end(self) -> None:
        """Print the results and the bag, or only the bag's path if quiet."""
        if not self.setup.options.quiet:
            self.print_result()
            if self.bag:
                self.bag.print_commands()
        elif self.bag:
            print(self.bag.recorder.path)  # noqa: T201


def check_left_out(part: str, options: Mapping[str, object]) -> None:
    """Refuse `options`, by name, that are for a part of the run that is left out.

    Raises
    ------
    UserError
        if one of them is given.

    Examples
    --------
    >>> check_left_out('controller', {'speed': None})
    >>> check_left_out('controller', {'speed': 10.0})  # doctest: +ELLIPSIS
    Traceback (most recent call last):
    barc_sim.errors.UserError: --speed 10.0 is for the controller that --no-controller ...
    """
    for name, value in options.items():
        if value is not None:
            raise UserError(
                f'--{name} {value} is for the {part} that --no-{part} leaves out: give one of the '
                'two only'
            )


def given(**values: float | str | None) -> dict[str, float | str]:
    """Return the parameters that the command line sets; the others keep the nodes' defaults.

    Examples
    --------
    >>> given(speed_reference=10.0, controller_type=None)
    {'speed_reference': 10.0}
    """
    return {name: value for name, value in values.items() if value is not None}
