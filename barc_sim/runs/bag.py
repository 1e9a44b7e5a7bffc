"""The bag of a run: its recorder, and what the run itself adds to the bag."""

from __future__ import annotations

import shlex
import shutil
from contextlib import suppress
from platform import platform, python_version
from typing import TYPE_CHECKING, Any

import yaml

from barc_sim import __version__
from barc_sim.bags.recording import summary
from barc_sim.cli.parser import barc_path
from barc_sim.control.types import GAINS
from barc_sim.lab.user_code.adapters import attachments
from barc_sim.lab.user_code.adapters import describe as user_code_metadata
from barc_sim.runs.recording_options import recording

if TYPE_CHECKING:
    from argparse import Namespace
    from collections.abc import Mapping, Sequence

    from barc_sim.lab.user_code.loading import UserCode
    from barc_sim.nodes.simulator import VehicleSimulator
    from barc_sim.runs.engine import Engine


class RunBag:
    """Records a run; what describes the run is kept in the bag's metadata.

    Attributes
    ----------
    recorder
        The node that writes the bag.
    """

    def __init__(self, options: Namespace, user_code: UserCode, engine: Engine) -> None:
        """Make the bag and its recorder, with the user's files attached.

        Raises
        ------
        UserError
            if the bag cannot be made.
        """
        self._root_is_new = not options.bag_dir.exists()
        self._engine = engine
        self.recorder = engine.recorder(
            options.bag_dir,
            recording(options),
            user_code_metadata(user_code),
            attachments(user_code),
        )

    def begin(self, argv: list[str]) -> None:
        """Describe the run that the command line `argv` made."""
        self.recorder.add_metadata(_description(argv, self._engine.parameters()))
        self._add_graph()

    def end(self, simulators: Sequence[VehicleSimulator]) -> None:
        """Add the results; to be called while the nodes still exist."""
        results = {
            'steps': sum(simulator.stepper.states for simulator in simulators),
            'missed_deadlines': sum(simulator.stepper.missed for simulator in simulators),
            'slipped_periods': sum(simulator.stepper.slipped for simulator in simulators),
        }
        self.recorder.add_metadata({name: str(value) for name, value in results.items()})
        self._add_graph()

    def discard(self) -> None:
        """Delete the bag; to be called after the recorder is destroyed."""
        shutil.rmtree(self.recorder.path)
        if self._root_is_new:
            with suppress(OSError):  # another run has its bag there
                self.recorder.path.parent.rmdir()

    def _add_graph(self) -> None:
        self.recorder.add_metadata({'graph': self._engine.graph().to_json()})

    def print_commands(self) -> None:
        """Print the bag's path, and the commands that read it."""
        barc = barc_path()
        recorder = self.recorder
        print(summary(recorder.counts, recorder.lost, recorder.left_out))  # noqa: T201
        path = shlex.quote(str(self.recorder.path))
        print(f'bag     {path}')  # noqa: T201
        print(f'plot    {barc} plot {path}')  # noqa: T201
        print(f'replay  {barc} replay {path}')  # noqa: T201


def _description(argv: list[str], parameters: Mapping[str, Mapping[str, Any]]) -> dict[str, str]:
    """Return what describes a run: `parameters` in the form that `ros2 param load` takes."""
    # By parameter, not by node: `-r __node:=car` gives all nodes one name.
    own = {name: value for values in parameters.values() for name, value in values.items()}
    return {
        'command': shlex.join(['barc', *argv]),
        'barc_sim': __version__,
        'python': python_version(),
        'platform': platform(),
        'parameters': yaml.safe_dump(
            {name: {'ros__parameters': dict(values)} for name, values in parameters.items()},
            sort_keys=False,
        ),
        **{name: str(own[name]) for name in (*GAINS, 'road') if name in own},
    }
