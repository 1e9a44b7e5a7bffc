"""The parts of a bag that are needed to repeat its run: log, parameters, user code."""

from __future__ import annotations

import hashlib
import tempfile
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING, Any

from barc_sim.bags import bounds, reader
from barc_sim.errors import UserError
from barc_sim.lab.check.code import LocalCode
from barc_sim.lab.grade.archives import Member
from barc_sim.lab.grade.code import ConfinedCode
from barc_sim.lab.grade.start import ON_LINUX
from barc_sim.lab.grade.submissions import Submission, take
from barc_sim.lab.user_code import adapters
from barc_sim.lab.user_code.loading import FILES, load_folder

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from barc_sim.lab.check.code import JudgedCode
    from barc_sim.lab.grade.start import Limits
    from barc_sim.simulation.log import Log


#: A parameter that only this kind of node has.
_SIMULATOR, _CONTROLLER = 'air_drag_coeff', 'speed_reference'
_PLACED = 'initialpose'


@dataclass(frozen=True)
class Recorded:
    """A recorded run."""

    log: Log
    simulator: Mapping[str, Any]  #: parameters
    controller: Mapping[str, Any] | None  #: parameters; None where there was none
    placements: int  #: messages that could have moved the car
    files: Mapping[str, str]  #: names of the user's files, by part
    sources: Mapping[str, bytes]  #: contents of the user's files, by name
    changed: tuple[str, ...]  #: files that do not match the hashes of the run


def read(path: Path, namespace: str | None = None) -> Recorded:
    """Read the bag at `path`; `namespace` is needed only where it has several cars.

    Raises
    ------
    UserError
        if there is none, or it lacks the parameters of its run.
    """
    log, info = reader.read(path, namespace), reader.info(path)
    car = f'/{(namespace or "").strip("/")}/'.replace('//', '/')
    nodes = _parameters(info.get('parameters', ''), car)
    simulator = next((node for node in nodes if _SIMULATOR in node), None)
    if simulator is None:
        raise UserError(
            f'{str(path)!r} has no parameters of a simulator: name the bag of a run of barc_sim'
        )
    files, hashes = _claims(info.get(adapters.METADATA, '{}'))
    sources = adapters.attached(reader.attachments(path))
    return Recorded(
        log=log,
        simulator=simulator,
        controller=next((node for node in nodes if _CONTROLLER in node), None),
        placements=reader.counts(path).get(_PLACED, 0),
        files={part: name for part, name in files.items() if name in sources},
        sources=sources,
        changed=tuple(
            sorted(
                name
                for name in hashes.keys() | sources.keys()
                if hashlib.sha256(sources.get(name, b'')).hexdigest() != hashes.get(name)
            )
        ),
    )


def _parameters(text: str, car: str) -> list[dict[str, Any]]:
    """Return the parameters of the nodes in a car's namespace."""
    try:
        nodes = bounds.from_yaml(text)
        return [
            dict(node['ros__parameters']) for name, node in nodes.items() if name.startswith(car)
        ]
    except (AttributeError, KeyError, TypeError, ValueError):
        return []


def _claims(text: str) -> tuple[dict[str, str], dict[str, str]]:
    try:
        claims = bounds.from_json(text)
        return tuple(  # type: ignore[return-value]
            {key: value for key, value in claims.get(name, {}).items() if isinstance(value, str)}
            for name in ('files', 'sha256')
        )
    except (AttributeError, ValueError):
        return {}, {}


@contextmanager
def attached(
    recorded: Recorded, limits: Limits, part: str, *, sandbox: bool
) -> Iterator[JudgedCode]:
    """Give one part of the attached code, ready to be called in a confined process.

    Where no process can be confined, it is called in this one.

    Raises
    ------
    UserError
        if a file is wrong, or this machine cannot confine it.
    """
    submission = Submission(part, _files(recorded, part))
    with tempfile.TemporaryDirectory(prefix='barc_sim_') as name:
        folder = Path(name)
        submission.write(folder)
        if not ON_LINUX:
            yield LocalCode(load_folder(folder, [part], budget=limits.call, packages=False))
            return
        with ConfinedCode(folder, limits, sandbox=sandbox) as code:
            yield code


def _files(recorded: Recorded, part: str) -> dict[str, bytes]:
    """Return a part's file, by its usual name, and the files beside it."""
    own = PurePosixPath(recorded.files[part])
    files = {FILES[part]: recorded.sources[recorded.files[part]]}
    others = []
    for name, data in recorded.sources.items():
        path = PurePosixPath(name)
        if path.is_relative_to(own.parent):
            path = path.relative_to(own.parent)
        elif not path.is_absolute() and '..' not in path.parts:
            continue
        if path != PurePosixPath(FILES[part]):
            others.append(Member(str(path), lambda size, data=data: data[:size]))  # type: ignore[misc]
    faults: list[str] = []
    take(others, files, faults)
    if faults:
        raise UserError(f'the bag has a file attached that no run attaches: {faults[0]}')
    return files
