"""Writes the run of each car in a bag as a table: a row for each state."""

from __future__ import annotations

import csv
import logging
import re
from typing import TYPE_CHECKING, Any

import numpy as np

from barc_sim.bags import reader
from barc_sim.errors import UserError
from barc_sim.simulation.log import TrackLog
from barc_sim.simulation.metrics import laps_of

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray

    from barc_sim.simulation.log import Log

_logger = logging.getLogger(__name__)
_NAME = 'run'
_MAX_NAME = 60  #: characters of a namespace in the name of its table: at most 240 bytes


def write_run_tables(path: Path, folder: Path) -> None:
    """Write `run.csv`, or one table for each of several cars, such as `car1.run.csv`.

    The columns are those of a log, the number of the lap from 0 on, and the parameters over time.
    A bag without a car gets no table; for a car whose states no run can have, there is a warning.

    Parameters
    ----------
    path
        The bag.
    folder
        The folder to write into. A table never replaces a file of it.
    """
    bag = reader.load(path)
    for car in bag.cars:
        name = _file_name(car)
        while (folder / f'{name}.csv').exists():  # the table of a topic
            name += '_'
        try:
            columns = _columns(bag.log(car))
        except UserError as error:
            _logger.warning('%s.csv is left out: %s', name, error)
            continue

        rows = zip(*(column.tolist() for column in columns.values()), strict=True)
        with (folder / f'{name}.csv').open('x', encoding='utf-8', newline='') as file:
            table = csv.writer(file)
            table.writerow(columns)
            table.writerows(rows)


def _file_name(car: str) -> str:
    """Return the name of a car's table without suffix, whatever characters its namespace has."""
    dotted = car.strip('/').replace('/', '.')
    prefix = re.sub(r'[^\w.]', '_', dotted).lstrip('.')[:_MAX_NAME]
    return f'{prefix}.{_NAME}' if prefix else _NAME


def _columns(log: Log) -> dict[str, NDArray[Any]]:
    """Return the columns of a table."""
    columns = dict(log.columns())
    if not isinstance(log, TrackLog):  # which has the number of its lap
        _, lap_numbers = laps_of(log)
        columns['lap'] = np.array(lap_numbers)
    columns |= log.parameters

    for name, column in columns.items():
        if column.dtype == np.bool_:
            columns[name] = column.astype(int)
    return columns
