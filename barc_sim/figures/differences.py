"""What runs differ in: the label of each in a comparison, such as `kp 20` or `lqr, noise_v_x 0.1`.

The parameters of a recorded run are in its bag's metadata, and in its log those that are numbers.
"""

from __future__ import annotations

import json
import textwrap
from contextlib import suppress
from typing import TYPE_CHECKING, Any

import numpy as np

from barc_sim.bags.parameters import described
from barc_sim.control.lane import LANE
from barc_sim.errors import escaped
from barc_sim.interfaces.nodes import CONTROLLER, SIMULATOR
from barc_sim.simulation.metrics import changes_of
from barc_sim.vehicle.parameters import LIVE

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from barc_sim.simulation.log import Log

#: Parameters that change nothing in what the car does.
_OF_PACE = {'use_sim_time', 'start_type_description_service', 'realtime_factor', 'clock'}
#: Parameters whose value is clear in a label without the parameter's name.
_PLAIN = {'controller_type', 'lane_type', 'dynamics', 'integrator'}
_CODE = 'code'  #: the user's files
_MAX_LABEL = 60  #: characters


def log_settings(log: Log) -> dict[str, str]:
    """Return the parameters of a log in words, such as `kp 20` or `kp 2 → 4`, by name."""
    texts = {}
    for full_name, values in log.parameters.items():
        known = values[~np.isnan(values)]
        if known.size:
            name = full_name.partition('.')[2]
            texts[name] = _in_words(name, float(known[0]))
    return _with_changes(texts, log)


def bag_settings(info: Mapping[str, str], car: str, log: Log) -> dict[str, str]:
    """Return the parameters of a recorded car in words, by name, and the names of the user's files.

    `info` is the metadata of its bag, `car` the car's namespace.
    """
    nodes = described(info.get('parameters', ''))
    texts = {}
    for node in (CONTROLLER, SIMULATOR):
        for name, value in nodes.get(f'{car.rstrip("/")}/{node}', {}).items():
            texts[name] = _in_words(name, value)
    files = _user_files(info)
    if files:
        texts[_CODE] = files
    return _with_changes(texts, log)


def labels_of(runs: Sequence[Mapping[str, str]], names: Sequence[str]) -> list[str]:
    """Return a label for each run: the settings in which they differ, or else its name."""
    differing = [name for name in _all_names(runs) if _differs(name, runs)]
    labels = []
    for run in runs:
        texts = {name: run[name] for name in differing if name in run}
        used = [text for name, text in texts.items() if not _is_off(name, text)]
        label = ', '.join(used or texts.values())
        labels.append(textwrap.shorten(escaped(label), _MAX_LABEL, placeholder=' …'))
    return [_unique(label, name, labels) for label, name in zip(labels, names, strict=True)]


def _unique(label: str, name: str, labels: Sequence[str]) -> str:
    """Return a label that no other run has: with the run's name where two are equal."""
    if not label:
        return name
    return f'{label} ({name})' if labels.count(label) > 1 else label


def _all_names(runs: Iterable[Mapping[str, str]]) -> list[str]:
    """Return the names of all settings, each once."""
    names: dict[str, None] = {}
    for run in runs:
        names |= dict.fromkeys(run)
    return [*names]


def _differs(name: str, runs: Sequence[Mapping[str, str]]) -> bool:
    """Return whether runs differ in a setting that counts.

    Controllers of two types have gains of their own: those that have a gain are compared.
    """
    if name in _OF_PACE:
        return False
    texts = {run[name] for run in runs if name in run}
    if name == _CODE:
        return len(texts) > 1 or any(name not in run for run in runs)
    return len(texts) > 1


def _is_off(name: str, text: str) -> bool:
    """Return whether a part of the plant is off, such as the noise."""
    return name in LIVE and text == _in_words(name, 0.0)


def _in_words(name: str, value: object) -> str:
    if name in _PLAIN:
        return str(value)
    text = f'{value:g}' if isinstance(value, float) else str(value)
    return f'{name.removeprefix(LANE)} {text}'


def _with_changes(texts: dict[str, str], log: Log) -> dict[str, str]:
    """Return the settings with what was changed during the run, such as `kp 2 → 4`."""
    changes = changes_of(log)
    return {name: changes.get(name.removeprefix(LANE), text) for name, text in texts.items()}


def _user_files(info: Mapping[str, str]) -> str:
    """Return the names of the user's files; empty: there are none, or the entry is invalid."""
    with suppress(ValueError, AttributeError, TypeError, RecursionError):
        code: Any = json.loads(info.get('student_code', '{}'))
        return ', '.join(map(str, code['files'].values())) if code else ''
    return ''
