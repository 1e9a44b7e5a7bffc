"""Runs a student's `compose.py` without ROS for some seconds, and judges its nodes."""

from __future__ import annotations

import ast
import json
import os
import runpy
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections import Counter
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from barc_sim.errors import UserError
from barc_sim.lab.user_code import source
from barc_sim.lab.user_code.calls import NOT_WRITTEN

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from types import FrameType

    from barc_sim.ros.local import World

#: The least number of nodes: a simulator, a relay, a driver and a recorder.
_NODES = 4
_SIMULATOR = '/vehicle_simulator'
#: Topics of the drive by hand; each has one publisher.
_TOPICS = ('/cmd_vel', '/ecu', '/z_vhcl')
_FOUND = 'found.json'
_DEADLINE = 60.0  #: [s] for all of it, on a busy machine
_MAX_FILE = 64 << 20  #: bytes of what it prints, and of its bag
_LAST_WORDS = 4096  #: bytes of what it has printed
_PATIENCE = 8.0  #: [s] of processor time for nodes to appear, and of any for them to be spun
_STABLE = 0.5  #: [s] for which nodes that are spun stay the same


class Verdict(NamedTuple):
    """Whether a composition is right, and why in a sentence."""

    right: bool
    sentence: str


def judge_composition(file: Path) -> Verdict:
    """Run the script in a process and folder of its own; it ends within a minute."""
    try:
        if _is_unwritten(file):
            return Verdict(True, NOT_WRITTEN)
    except UserError as error:
        return Verdict(False, str(error))
    if sys.platform == 'win32':
        return Verdict(True, 'not run: a keyboard needs the terminal of Linux or macOS')
    seen, death = _run(file)
    if death or not seen:
        return Verdict(False, death or 'it has made no node')
    if faults := _faults(seen):
        return Verdict(False, '; '.join(faults))
    return Verdict(
        True,
        f'{_listed(seen)}; each of {", ".join(_TOPICS)} has one publisher',
    )


def _is_unwritten(file: Path) -> bool:
    """Return whether the script still raises the template's NotImplementedError."""
    tree = source.compiled(source.read(file, file.name)).tree
    return any(
        isinstance(node, ast.Raise) and ast.unparse(node) == 'raise NotImplementedError'
        for node in ast.walk(tree)
    )


class _Seen(NamedTuple):
    """What is seen of the running script."""

    nodes: Sequence[str]  #: full names; two nodes can have the same
    publishers: Mapping[str, Sequence[str]]  #: of each topic, by node


def _run(file: Path) -> tuple[_Seen | None, str]:
    """Return what is seen of the script's nodes once that is stable, and how the script died."""
    import pty  # noqa: PLC0415 (of Unix)

    ours, theirs = pty.openpty()  # a keyboard needs a terminal
    with tempfile.TemporaryDirectory() as folder, tempfile.TemporaryFile() as output:
        process = subprocess.Popen(  # noqa: S603 (the user's own file)
            [sys.executable, '-m', __name__, str(file.resolve())],
            cwd=folder,
            env=os.environ | {'PYTHONIOENCODING': 'utf-8'},
            stdin=theirs,
            stdout=output,
            stderr=subprocess.STDOUT,
            start_new_session=True,
        )
        try:
            code = process.wait(_DEADLINE)
        except subprocess.TimeoutExpired:
            return None, f'it was ended after {_DEADLINE:g} s: does one call last for ever?'
        finally:
            with suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)  # and what it has started
            process.wait()
            os.close(ours)
            os.close(theirs)
        found = Path(folder, _FOUND)
        if found.exists():
            nodes, publishers = json.loads(found.read_text(encoding='utf-8'))
            return (_Seen(nodes, publishers) if nodes else None), ''
        output.seek(max(output.seek(0, os.SEEK_END) - _LAST_WORDS, 0))
        lines = output.read().decode(errors='replace').strip().splitlines()
    last = f': {lines[-1][:200]}' if lines and code else ''
    return None, f'it has ended with exit code {code}{last}'


def _watch(world: World) -> None:
    """Write what is seen of the nodes in this process to a file, and end the process."""
    seen, since, now, end = _Seen((), {}), 0.0, 0.0, time.monotonic() + 0.8 * _DEADLINE
    while now < end and (seen.nodes or time.process_time() < _PATIENCE):
        if seen.nodes and now > since + (_STABLE if _spins() else _PATIENCE):
            break
        time.sleep(0.05)
        now = time.monotonic()
        nodes = [*world.nodes]
        publishers = {
            topic: sorted(
                node.get_name()
                for node in nodes
                for p in [*node.publishers]
                if p.topic_name == topic
            )
            for topic in _TOPICS
        }
        names = sorted(node.get_fully_qualified_name() for node in nodes)
        if (names, publishers) != seen:
            seen, since = _Seen(names, publishers), now
    Path(_FOUND).write_text(json.dumps(seen), encoding='utf-8')
    os._exit(0)


def _spins() -> bool:
    """Return whether a thread spins an executor: then all nodes are there."""
    for found in sys._current_frames().values():  # noqa: SLF001 (documented)
        frame: FrameType | None = found
        while frame:
            code, frame = frame.f_code, frame.f_back
            if code.co_name.startswith('spin') and 'local' in Path(code.co_filename).parts:
                return True
    return False


def _run_here(file: str) -> None:
    """Run the script on what stands in for ROS, with a thread that watches its nodes."""
    import resource  # noqa: PLC0415 (of Unix)

    from barc_sim.ros.local import install  # noqa: PLC0415 (as the script's own process)

    resource.setrlimit(resource.RLIMIT_FSIZE, (_MAX_FILE, _MAX_FILE))  # of what it prints, too
    threading.Thread(target=_watch, args=[install()], daemon=True).start()
    sys.argv = [file]
    sys.path[0] = str(Path(file).parent)
    runpy.run_path(file, run_name='__main__')


def _listed(seen: _Seen) -> str:
    return f'{len(seen.nodes)} nodes, {", ".join(seen.nodes)}'


def _faults(seen: _Seen) -> list[str]:
    faults = []
    if len(seen.nodes) < _NODES:
        faults.append(
            f'{_listed(seen)}; expected {_NODES}: a simulator, a relay, a driver and a recorder. '
            'Is each made and added to the executor?'
        )
    if _SIMULATOR not in seen.nodes:
        faults.append(f'there is no node {_SIMULATOR}')
    twice = [name for name, number in Counter(seen.nodes).items() if number > 1]
    faults += [f'{name} is there twice: a node needs a name of its own' for name in twice]
    for topic, names in seen.publishers.items():
        if len(names) != 1:
            found = f' ({", ".join(names)})' if names else ''
            faults.append(f'{topic} has {len(names)} publishers{found}; expected one')
    return faults


if __name__ == '__main__':
    _run_here(sys.argv[1])
