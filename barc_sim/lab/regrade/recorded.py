"""What a bag says of a run, as far as it takes to do it again."""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import yaml

from barc_sim.bags import reader
from barc_sim.errors import UserError
from barc_sim.lab.user_code.adapters import FOLDER, METADATA

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from barc_sim.simulation.log import Log

#: A parameter by which a node is known, whatever it is called.
_SIMULATOR, _CONTROLLER = 'air_drag_coeff', 'speed_reference'
_PLACED = 'initialpose'


@dataclass(frozen=True)
class Recorded:
    """A run."""

    log: Log
    simulator: Mapping[str, Any]  #: parameters
    controller: Mapping[str, Any] | None  #: parameters; None where there was none
    placements: int  #: messages that may have put the car elsewhere
    files: Mapping[str, str]  #: the names of a user's sources, by part
    sources: Mapping[str, bytes]  #: a user's files, by name
    changed: tuple[str, ...]  #: those that are not what the run's hashes say


def read(path: Path, namespace: str | None = None) -> Recorded:
    """Read the bag at `path`; `namespace` is needed only where it has several cars.

    Raises
    ------
    UserError
        There is none, or it does not tell of the parameters of its run.
    """
    log, info = reader.read(path, namespace), reader.info(path)
    car = f'/{(namespace or "").strip("/")}/'.replace('//', '/')
    nodes = _parameters(info.get('parameters', ''), car)
    simulator = next((node for node in nodes if _SIMULATOR in node), None)
    if simulator is None:
        raise UserError(
            f'{str(path)!r} does not tell of the parameters of its simulator: name the bag of a '
            'run of barc_sim'
        )
    files, hashes = _claims(info.get(METADATA, '{}'))
    sources = {
        name.removeprefix(FOLDER): data
        for name, data in reader.attachments(path).items()
        if name.startswith(FOLDER)
    }
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
        nodes = yaml.safe_load(text)
        return [
            dict(node['ros__parameters']) for name, node in nodes.items() if name.startswith(car)
        ]
    except (yaml.YAMLError, AttributeError, KeyError, TypeError, ValueError):
        return []


def _claims(text: str) -> tuple[dict[str, str], dict[str, str]]:
    try:
        claims = json.loads(text)
        return dict(claims.get('files', {})), dict(claims.get('sha256', {}))
    except (AttributeError, TypeError, ValueError):
        return {}, {}
