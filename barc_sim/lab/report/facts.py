"""Reads the facts for a report from a bag."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from barc_sim.bags import reader
from barc_sim.bags.node_graph import NodeGraph
from barc_sim.bags.records import files
from barc_sim.figures.style import use_measurement
from barc_sim.lab.user_code import adapters
from barc_sim.simulation.laps import laps_of

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from numpy.typing import NDArray

    from barc_sim.simulation.laps import Lap, Laps
    from barc_sim.simulation.log import Log

#: Larger values are from a damaged bag.
_ABSURD = 1e9


@dataclass(frozen=True)
class Facts:
    """The facts of a run for a report."""

    name: str
    log: Log
    info: Mapping[str, str]
    laps: Laps
    graph: NodeGraph | None
    sources: Mapping[str, str]  #: user code, by file name
    hashes: Mapping[str, str]  #: SHA-256 of the sources and of the bag's files, by name

    @property
    def shown_lap(self) -> Lap:
        """The lap whose figures are shown: the best, or the only one."""
        return self.laps.best or self.laps.current


def read(path: Path, namespace: str | None = None) -> Facts:
    """Read the bag at `path`.

    Raises
    ------
    UserError
        if there is none, or it has no car, or several.

    Examples
    --------
    >>> from barc_sim.bags.reader import newest
    >>> facts = read(newest('bags'))
    >>> facts.shown_lap.number
    0
    """
    log = _sensible(reader.read(path, namespace))
    info = reader.info(path)
    attached = adapters.attached(reader.attachments(path))
    hashes = {name: hashlib.sha256(data).hexdigest() for name, data in attached.items()}
    for file in files(path):
        hashes[file.name] = _sha256(file)
    directory = path if path.is_dir() else path.parent
    return Facts(
        name=directory.resolve().name,
        log=log,
        info=info,
        laps=laps_of(log)[0],
        graph=_graph(info.get('graph')),
        sources={name: data.decode(errors='replace') for name, data in attached.items()},
        hashes=hashes,
    )


def _sensible(log: Log) -> Log:
    """Return the log without values that cannot be drawn."""

    def known(column: NDArray[Any]) -> NDArray[Any]:
        if column.dtype == np.bool_:
            return column
        return np.where(np.abs(column) < _ABSURD, column, np.nan)

    return use_measurement(log.map(known))


def _graph(text: str | None) -> NodeGraph | None:
    if text is None:
        return None
    try:
        return NodeGraph.from_json(text)
    except ValueError:
        return None


def _sha256(file: Path) -> str:
    digest = hashlib.sha256()
    with file.open('rb') as stream:
        while piece := stream.read(1 << 20):
            digest.update(piece)
    return digest.hexdigest()
