"""Runs a student's `compose.py` without ROS for some seconds, and judges its nodes."""

from __future__ import annotations

import ast
import json
import os
import re
import runpy
import signal
import subprocess
import sys
import tempfile
from pathlib import Path
from traceback import walk_stack
from typing import TYPE_CHECKING, NamedTuple

from barc_sim.cli.files import read_regular
from barc_sim.cli.python import python_command
from barc_sim.errors import UserError
from barc_sim.lab import files
from barc_sim.lab.confined.replies import Fields, ListOf, Row, Text, max_size
from barc_sim.lab.user_code.folder import NOT_WRITTEN

if TYPE_CHECKING:
    from types import FrameType

    from barc_sim.ros.local import World

#: The minimum number of nodes: a simulator, a relay, a driver and a recorder.
_NODES = 4
_SIMULATOR = '/vehicle_simulator'
#: Topics of the drive by hand; each has one publisher.
_TOPICS = ('/cmd_vel', '/ecu', '/z_vhcl')
_RESULT = 'nodes.json'
_NAMES = ListOf(Text(300), 300, or_fewer=True)
#: The nodes, the publishers by topic, and the nodes without an executor.
_REPORT = Row((_NAMES, Fields(dict.fromkeys(_TOPICS, _NAMES)), _NAMES))
_DEADLINE = 60.0  #: [s] for the whole check, on a busy machine
_PERIOD = 1.0  #: [s] between two looks at the nodes
#: Looks without a new node, after which all nodes are made, even if no executor spins in the main
#: thread.
_MAX_LOOKS = 10


class Verdict(NamedTuple):
    """Whether a composition is right, with the reason in a sentence."""

    right: bool
    sentence: str


def judge_composition(file: Path) -> Verdict:
    """Judge a script's nodes; it runs in its own process and folder, for a minute at most."""
    try:
        if _is_unwritten(file):
            return Verdict(True, NOT_WRITTEN)
    except UserError as error:
        return Verdict(False, str(error))
    if sys.platform == 'win32':
        return Verdict(True, 'not run: a keyboard needs the terminal of Linux or macOS')

    with tempfile.TemporaryDirectory() as folder:
        try:
            end = _run_apart(file, folder)
        except subprocess.TimeoutExpired:
            reason = f'it was ended after {_DEADLINE:g} s: does a call never return?'
            return Verdict(False, reason)

        result = Path(folder, _RESULT)
        if os.path.lexists(result):
            return _reported(result)
    return Verdict(False, _explain_end(file, end))


class _End(NamedTuple):
    """How a script's process has ended."""

    code: int
    output: str


def _run_apart(file: Path, folder: str) -> _End:
    """Run the script in a process and a folder of its own, with a terminal for its keyboard."""
    import pty  # noqa: PLC0415 (of Unix)

    our_end, script_end = pty.openpty()

    with tempfile.TemporaryFile() as output:
        try:
            process = subprocess.run(  # noqa: S603 (the user's own file)
                python_command(__name__, str(file.resolve())),
                cwd=folder,
                stdin=script_end,
                stdout=output,
                stderr=output,
                timeout=_DEADLINE,
                check=False,
            )
        finally:
            os.close(our_end)
            os.close(script_end)

        output.seek(0)
        text = output.read().decode(errors='replace').strip()
    return _End(process.returncode, text)


def _explain_end(file: Path, end: _End) -> str:
    """Return why a script that has reported no nodes is wrong, with its line if it has raised."""
    if end.code:
        reason = end.output.rpartition('\n')[2][:200]
    else:
        reason = 'is main called, and does an executor spin?'

    lines = re.findall(rf'File "{re.escape(str(file.resolve()))}", line (\d+)', end.output)
    place = f'{file.name}, line {lines[-1]}: ' if lines else ''
    return f'{place}it has ended with exit code {end.code}: {reason}'.rstrip(': ')


def _reported(result: Path) -> Verdict:
    """Judge what the script's process has written; the script can write there, too."""
    try:
        data = read_regular(result, max_size(_REPORT), follow=False)
        nodes, publishers, idle = _REPORT.checked(json.loads(data))
    except (OSError, ValueError, RecursionError):
        return Verdict(False, f'it has written {_RESULT}, which barc check needs: write another')
    return _verdict(nodes, publishers, idle)


def _is_unwritten(file: Path) -> bool:
    """Return whether the script still raises the template's NotImplementedError."""
    tree = files.compiled(files.read_source(file, file.name)).tree
    return any(
        isinstance(node, ast.Raise) and ast.unparse(node) == 'raise NotImplementedError'
        for node in ast.walk(tree)
    )


class _NodeReport:
    """Looks at the nodes of a script once a second, and reports them when all are made."""

    def __init__(self, world: World) -> None:
        """Look at the nodes of `world`."""
        self._world = world
        self._count = 0  # of the nodes at the last look
        self._looks = 0  # without a new node

    def look(self, _: int, frame: FrameType | None) -> None:
        """Report the nodes and exit, once an executor spins or no more nodes come."""
        count = len(self._world.nodes)
        if count == self._count and count > 0:
            self._looks += 1
        else:
            self._looks = 0
        self._count = count

        looks_required = 1 if _is_spinning(frame) else _MAX_LOOKS
        if self._looks >= looks_required:
            self._write()
            os._exit(0)

    def _write(self) -> None:
        """Write the names of the nodes, the publishers by topic, and the idle nodes."""
        publishers: dict[str, list[str]] = {topic: [] for topic in _TOPICS}
        for node in self._world.nodes:
            for publisher in node.publishers:
                if publisher.topic_name in publishers:
                    publishers[publisher.topic_name].append(node.get_name())
        names = sorted(node.get_fully_qualified_name() for node in self._world.nodes)
        idle = [node.get_name() for node in self._world.nodes if node.executor is None]
        Path(_RESULT).write_text(json.dumps((names, publishers, idle)), encoding='utf-8')


def _run_here(file: str) -> None:
    """Run the script on `ros/local`; write its nodes, publishers and idle nodes to a file."""
    from barc_sim.ros.local import install  # noqa: PLC0415 (only in the script's process)

    report = _NodeReport(install())
    signal.signal(signal.SIGALRM, report.look)
    signal.setitimer(signal.ITIMER_REAL, _PERIOD, _PERIOD)
    sys.argv = [file]
    sys.path.insert(0, str(Path(file).parent))  # as for any script
    try:
        runpy.run_path(file, run_name='__main__')
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)  # it would end the interpreter while that exits


def _is_spinning(frame: FrameType | None) -> bool:
    """Return whether an executor spins in this frame: a script makes its nodes before that."""
    from barc_sim.ros.local.executor import Executor  # noqa: PLC0415 (only in the script's process)

    return any(each.f_code is Executor.run_once.__code__ for each, _ in walk_stack(frame))


def _verdict(nodes: list[str], publishers: dict[str, list[str]], idle: list[str]) -> Verdict:
    """Judge the script's nodes, the publishers of each topic, and nodes without an executor."""
    listed = f'{len(nodes)} nodes, {", ".join(nodes)}'
    faults: list[str] = []
    if len(nodes) < _NODES:
        faults.append(
            f'{listed}; expected {_NODES}: a simulator, a relay, a driver and a recorder. '
            'Is each made?'
        )
    if idle:
        faults.append(f'no executor has {", ".join(idle)}: call its add_node with each node')
    if _SIMULATOR not in nodes:
        faults.append(f'there is no node {_SIMULATOR}')
    for topic, names in publishers.items():
        if len(names) != 1:
            nodes_of = f' ({", ".join(names)})' if names else ''
            faults.append(f'{topic} has {len(names)} publishers{nodes_of}; expected one')

    if faults:
        return Verdict(False, '; '.join(faults))
    return Verdict(True, f'{listed}; each of {", ".join(_TOPICS)} has one publisher')


if __name__ == '__main__':
    _run_here(sys.argv[1])
