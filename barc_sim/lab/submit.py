"""Packs what a student hands in: code, bags, reports, video and description, in one zip."""

from __future__ import annotations

import shutil
import zipfile
from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from barc_sim.bags import bag_files, reader
from barc_sim.cli.files import HeldFolder, open_regular
from barc_sim.errors import UserError
from barc_sim.lab.files import files_in, handout_of, names_of
from barc_sim.lab.run_report import page, read
from barc_sim.lab.submission import SUMMARY, listed, read_submission, take
from barc_sim.simulation.log import TrackLog
from barc_sim.simulation.metrics import RUN_UP

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping, Sequence
    from pathlib import Path


_CODE = 'code'  # the name of a part
_VIDEOS = ('.mp4', '.gif', '.webm', '.mkv', '.mov')
_DESCRIPTIONS = ('description.md', 'description.txt', 'description.pdf', 'report.pdf')


class ZipPart(NamedTuple):
    """A part of the zip, with the line that is printed for it."""

    name: str
    text: str  #: what it contains, or what is missing and how to make it
    files: Mapping[str, bytes | Path] = {}  #: by name in the zip
    missing: bool = False

    def __str__(self) -> str:
        """Return the line."""
        return f'{self.name:12}  {"missing: " if self.missing else ""}{self.text}'


def collect(folder: Path, course: Path | None, why: str, teleop: Path | None) -> Iterator[ZipPart]:
    """Yield the parts of a student's `folder`, with the bags of the drives.

    `course` is the bag of the drive with the lab's command, which is `Handout.drive`. `why` is the
    reason if there is none, or if the drive failed. `teleop` is the bag of a drive by hand.
    """
    yield from _code(folder)
    if why:
        yield ZipPart('course', why, missing=True)
    if course:
        yield _course(course)
    if 'relay' in handout_of(files_in(folder)).files:
        yield _teleop(teleop)
        yield _video(folder)

    names = [name for name in _DESCRIPTIONS if (folder / name).is_file()]
    text = 'write what you did, and why, in description.md'
    files = {name: folder / name for name in names}
    yield ZipPart('description', ', '.join(names) or text, files, missing=not names)


def write(path: Path, parts: Iterable[ZipPart]) -> None:
    """Write the files of `parts`, and their lines, as a zip; a link raises a UserError."""
    parts = [*parts]
    files: dict[str, bytes | Path] = {}
    for part in parts:
        files |= part.files

    with zipfile.ZipFile(path, 'w', zipfile.ZIP_DEFLATED) as archive:
        for name, data in files.items():
            if isinstance(data, bytes):
                archive.writestr(name, data)
                continue
            with (
                open_regular(data, follow=False) as file,
                archive.open(name, 'w', force_zip64=True) as packed,
            ):
                shutil.copyfileobj(file, packed)
        archive.writestr(SUMMARY, ''.join(f'{part}\n' for part in parts))


def unread(path: Path, parts: Iterable[ZipPart]) -> list[str]:
    """Return a sentence on each file of code in a zip that `grade` does not read.

    The zip is read as `grade` reads it, so that both have the same limits.
    """
    submission = read_submission(path)
    if not submission.files:
        return [f'barc grade does not read it: {note}' for note in submission.notes]
    code = [name for part in parts if part.name == _CODE for name in part.files]
    return [f'barc grade does not read {name}' for name in code if name not in submission.files]


def newest_drive(folders: Sequence[Path]) -> Path | None:
    """Return the newest bag of a drive by hand in one of `folders`."""
    files = {file for folder in folders for file in folder.glob('*/*.mcap')}
    newest_first = sorted(files, key=lambda file: file.stat().st_mtime_ns, reverse=True)
    for file in newest_first:
        if _is_by_hand(file.parent):
            return file.parent
    return None


def _is_by_hand(bag: Path) -> bool:
    """Return whether a bag was recorded by `barc teleop`."""
    try:
        return reader.info(bag).get('command', '').split()[1:2] == ['teleop']
    except UserError:
        return False


def _code(folder: Path) -> Iterator[ZipPart]:
    """Yield the code that `grade` reads, and a line for each file that is still to be written."""
    with HeldFolder(folder.resolve()) as held:
        files, notes = take(listed(held))

    names = [name for name in files if name.endswith('.py')]
    others = len(files) - len(names)
    text = ', '.join(names)
    if others:
        text += f', other files: {others}'
    yield ZipPart(_CODE, text or 'no file', dict(files), missing=not files)
    for note in notes:
        yield ZipPart(_CODE, f'{note}: it is left out')

    by_part = names_of(files)
    handout = handout_of(by_part)
    expected = {name: by_part.get(part, name) for part, name in handout.files.items()}
    expected |= {name: name for name in handout.others}
    for name, actual in expected.items():
        if actual not in files:
            yield ZipPart(_CODE, name, missing=True)
        elif files[actual] == handout.templates()[name]:
            yield ZipPart(_CODE, f'{actual} is still the template', missing=True)


def _course(bag: Path) -> ZipPart:
    facts = read(bag)
    # `submit` has made the command: nobody has typed it.
    facts = replace(facts, info={key: text for key, text in facts.info.items() if key != 'command'})
    result = facts.shown_lap.summary
    log = facts.log

    text = f'{log.distance[-1]:.1f} m in {log.t[-1]:.1f} s'
    if facts.holds_speed and result.max_error_after_run_up >= 0.0:
        text += (
            f'; after the first {RUN_UP:g} m the RMS error is {result.rms_error_after_run_up:.3f} '
            f'm/s, the maximum {result.max_error_after_run_up:.3f} m/s'
        )
    if isinstance(log, TrackLog):
        text = f'{len(log.lap_times)} laps; maximum e_y {np.abs(log.e_y).max():.2f} m'
    return ZipPart('course', text, _bag(bag, 'course') | {'report.html': page(facts).encode()})


def _bag(bag: Path, name: str) -> dict[str, bytes | Path]:
    """Return the files of a bag, in the folder `name` of the zip."""
    directory = bag if bag.is_dir() else bag.parent
    files = [*bag_files.files(bag), directory / 'metadata.yaml']
    return {f'{name}/{file.name}': file for file in files if file.is_file()}


def _teleop(bag: Path | None) -> ZipPart:
    if bag is None:
        return ZipPart('teleop', 'drive with barc teleop, or name a bag: --teleop', missing=True)
    try:
        facts = read(bag)
    except UserError as error:
        return ZipPart('teleop', str(error), missing=True)

    command = facts.info.get('command', 'command unknown')
    if facts.holds_speed:
        text = f'a controller drove {str(bag)!r} ({command}): name a drive by hand'
        return ZipPart('teleop', text, missing=True)
    text = f'{facts.log.t[-1]:.1f} s by hand ({command})'
    return ZipPart('teleop', text, _bag(bag, 'teleop') | {'teleop.html': page(facts).encode()})


def _video(folder: Path) -> ZipPart:
    videos = {file.name: file for file in folder.glob('*') if file.suffix.lower() in _VIDEOS}
    text = 'save one in your folder: barc replay BAG --save …/drive.mp4'
    return ZipPart('video', ', '.join(videos) or text, videos, missing=not videos)
