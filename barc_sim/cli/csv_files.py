"""Reads CSV files that anyone may have written, as the usual programs write them.

Excel writes semicolons where the comma is decimal, tabs in UTF-16 ("Unicode text"), and on a Mac
lines that end with a bare carriage return; its older files are in Windows-1252.
"""

from __future__ import annotations

import csv
import io
from typing import TYPE_CHECKING

from barc_sim.cli.files import decoded, read_regular

if TYPE_CHECKING:
    from pathlib import Path

MAX_CSV = 4 << 20  #: bytes
_MAX_ROWS = 200_000
_MAX_CELLS = 1_000_000
_DELIMITERS = ',;\t'
_SEPARATOR = 'sep='  # Excel's first line, as in `sep=;`


def rows_of(text: str) -> list[list[str]]:
    r"""Return the rows of a CSV text, without blank ones; the first row shows the delimiter.

    Raises
    ------
    ValueError
        A quotation mark is not closed, or there are too many cells.

    Examples
    --------
    >>> rows_of('name;id\rAda;7\r')
    [['name', 'id'], ['Ada', '7']]
    """
    lines = io.StringIO(text, newline='')
    first = next((line for line in lines if line.strip()), '')
    words = first.strip().lower()
    if words in [_SEPARATOR + delimiter for delimiter in _DELIMITERS]:
        delimiter = words[-1]
    else:
        delimiter = max(_DELIMITERS, key=first.count)
        lines.seek(0)

    rows: list[list[str]] = []
    cells = 0
    reader = csv.reader(lines, delimiter=delimiter, strict=True)
    try:
        for row in reader:
            cells += len(row)
            if len(rows) >= _MAX_ROWS or cells > _MAX_CELLS:
                raise ValueError(f'it has more than {_MAX_ROWS} rows or {_MAX_CELLS} cells')
            if any(map(str.strip, row)):
                rows.append(row)
    except csv.Error as error:
        raise ValueError(f'line {reader.line_num}: {error}') from None
    return rows


def read_rows(path: Path) -> list[list[str]]:
    """Return the rows of a CSV file, as `rows_of` does.

    Raises
    ------
    UserError
        It is no regular file, or too large.
    ValueError
        It is no CSV text.
    OSError
        It cannot be read.
    """
    return rows_of(decoded(read_regular(path, MAX_CSV)))
