"""Runs a student's `compose.py` for some seconds, and judges the graph of its nodes."""

from __future__ import annotations

import ast
import os
import tempfile
from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from barc_sim.cli.process import has_ros
from barc_sim.lab.user_code.call import NOT_WRITTEN

if TYPE_CHECKING:
    from collections.abc import Mapping

#: The least number of nodes: a simulator, a relay, a driver and a recorder.
_NODES = 4
_SIMULATOR = '/vehicle_simulator'
#: Topics of the drive by hand; each has one publisher.
_TOPICS = ('/cmd_vel', '/ecu', '/z_vhcl')


class Verdict(NamedTuple):
    """Whether a composition is right, and why in a sentence."""

    right: bool
    sentence: str


def judge_composition(file: Path) -> Verdict:
    """Run the script in a process, ROS domain and folder of its own; it ends within 15 s.

    Examples
    --------
    >>> _ = Path('compose.py').write_text('raise NotImplementedError')
    >>> judge_composition(Path('compose.py')).sentence
    'is not written yet (TODO)'
    """
    if _is_unwritten(file):
        return Verdict(True, NOT_WRITTEN)
    if not has_ros():
        return Verdict(True, 'not run: it needs ROS 2, which is not here')
    seen, death = _run(file)
    if death or not seen:
        return Verdict(False, death or 'no node has appeared within 8 s')
    if faults := _faults(seen):
        return Verdict(False, '; '.join(faults))
    return Verdict(
        True,
        f'{_listed(seen)}; each of {", ".join(_TOPICS)} has one publisher',
    )


def _is_unwritten(file: Path) -> bool:
    """Return whether the script still raises the template's NotImplementedError."""
    try:
        tree = ast.parse(file.read_bytes())
    except (OSError, SyntaxError, ValueError):
        return False  # running it names the fault
    return any(
        isinstance(node, ast.Raise) and ast.unparse(node) == 'raise NotImplementedError'
        for node in ast.walk(tree)
    )


class _Seen(NamedTuple):
    """What is seen of the running script."""

    nodes: tuple[str, ...]  #: full names; two nodes can have the same
    publishers: Mapping[str, tuple[str, ...]]  #: of each topic, by node


def _run(file: Path) -> tuple[_Seen | None, str]:
    """Return what is seen of the script's nodes once that is stable, and how the script died."""
    import pty  # noqa: PLC0415 (of Unix)

    from barc_sim.ros.introspection.observer import observe  # noqa: PLC0415 (ROS may be absent)
    from barc_sim.ros.peers import reserved_domain  # noqa: PLC0415
    from barc_sim.runs.program import Program  # noqa: PLC0415 (signals of Unix)

    deaths: list[str] = []
    # A keyboard needs a terminal.
    ours, theirs = pty.openpty()
    with reserved_domain() as domain, tempfile.TemporaryDirectory() as folder:
        os.environ['ROS_DOMAIN_ID'] = str(domain)
        with observe('check') as observer:
            program = Program(
                'it', file, lambda _: None, deaths.append, folder=Path(folder), stdin=theirs
            )

            def read() -> _Seen | None:
                nodes = tuple(observer.nodes())
                ends = {topic: observer.endpoints(topic)[0] for topic in _TOPICS}
                names = {topic: tuple(sorted(e.node_name for e in ends[topic])) for topic in ends}
                return _Seen(nodes, names) if nodes or deaths else None

            try:
                seen = observer.wait_until_stable(read)
            finally:
                program.close()
                os.close(ours)
                os.close(theirs)
    return seen, ''.join(deaths[:1])


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
