"""CSV files as spreadsheets write them, or a sentence."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from barc_sim.cli.csv_files import read_rows, rows_of

if TYPE_CHECKING:
    from pathlib import Path

ROWS = [['name', 'id'], ['Müller, Zoë', '7'], ['Ada', '8']]


@pytest.mark.parametrize('encoding', ['utf-8', 'utf-8-sig', 'utf-16', 'cp1252'])
@pytest.mark.parametrize('end', ['\n', '\r\n', '\r'])
@pytest.mark.parametrize('delimiter', [',', ';', '\t'])
def test_csv_files_of_spreadsheets_are_read(
    tmp_path: Path, encoding: str, end: str, delimiter: str
) -> None:
    lines = (delimiter.join(f'"{cell}"' for cell in row) for row in ROWS)
    file = tmp_path / 'class.csv'
    file.write_bytes(''.join(f'{line}{end}' for line in lines).encode(encoding))
    assert read_rows(file) == ROWS


def test_the_first_line_can_name_the_separator() -> None:
    assert rows_of('sep=;\r\na,b;c\r\n') == [['a,b', 'c']]


def test_blank_lines_are_left_out_and_lines_in_quotes_kept() -> None:
    assert rows_of('\n\na,b\n\n ,\n"1\n2",3\n') == [['a', 'b'], ['1\n2', '3']]
    assert rows_of('') == []


@pytest.mark.parametrize(
    ('data', 'reason'),
    [
        (b'a,b\n1,"2\n3,4\n', 'line 3: unexpected end of data'),
        (b'a,b\n1,"2" 3\n', 'line 2'),
        (b'a,b\n' + b'1' * 200_000, 'line 2: field larger than field limit'),
        (b'a\n' * 200_001, 'more than 200000 rows'),
        (b',' * 999_999 + b'\n1,2\n', 'or 1000000 cells'),
        (b'a\0b', 'it is no text'),
        (b'\xff\xfea', 'it is no text'),
    ],
)
def test_a_file_without_a_table_is_refused(tmp_path: Path, data: bytes, reason: str) -> None:
    file = tmp_path / 'class.csv'
    file.write_bytes(data)
    with pytest.raises(ValueError, match=reason):
        read_rows(file)
