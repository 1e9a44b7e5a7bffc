"""What `submit` packs is what `grade` reads: both have the limits of `submission.py`."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest
from user_files import PLAIN_MODEL

from barc_sim.lab import submission
from barc_sim.lab.submission import MAX_FILES, read_submission
from barc_sim.lab.submit import collect, unread, write

if TYPE_CHECKING:
    from pathlib import Path


@pytest.fixture
def lab(tmp_path: Path) -> Path:
    """Return a folder with a model."""
    folder = tmp_path / 'mine'
    folder.mkdir()
    (folder / 'bike_model.py').write_text(PLAIN_MODEL)
    return folder


@pytest.fixture
def packed(tmp_path: Path) -> Path:
    """Return the path of a zip."""
    return tmp_path / 'mine.zip'


@pytest.mark.parametrize('count', [MAX_FILES - 1, MAX_FILES + 9])
def test_grade_reads_each_file_that_submit_packs_as_code(
    lab: Path, packed: Path, count: int
) -> None:
    for k in range(count):
        (lab / f'helper_{k:03}.py').write_text('')
    parts = [*collect(lab, None, '', None)]
    write(packed, parts)

    read = read_submission(packed)
    assert read.files == parts[0].files
    assert len(read.files) == MAX_FILES
    assert read.notes == ()
    assert unread(packed, parts) == []


def test_a_summary_of_the_student_is_no_code(lab: Path, packed: Path) -> None:
    (lab / 'summary.txt').write_text('mine')
    parts = [*collect(lab, None, '', None)]
    write(packed, parts)
    assert {*read_submission(packed).files} == {'bike_model.py'}


def test_what_grade_does_not_read_is_named(
    lab: Path, packed: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    parts = [*collect(lab, None, '', None)]
    write(packed, parts)
    monkeypatch.setattr(submission, 'MAX_ARCHIVE', 1 << 8)
    assert unread(packed, parts) == [
        'barc grade does not read it: it is larger than 0 MiB: leave the video out'
    ]


def test_a_file_that_an_earlier_note_hides_is_named(lab: Path, packed: Path) -> None:
    parts = [*collect(lab, None, '', None)]
    parts[0] = parts[0]._replace(files={**parts[0].files, '.hidden/own.py': b''})
    write(packed, parts)
    assert unread(packed, parts) == ['barc grade does not read .hidden/own.py']
