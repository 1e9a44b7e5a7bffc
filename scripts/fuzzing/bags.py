"""Damaged bags: any bytes, and each field of each kind of record of the file's format, MCAP.

Each bag goes through one of `plot`, `replay`, `report` and `graph`, and through
`recover`; what that leaves is read again.
"""

from __future__ import annotations

import io
import subprocess
import sys
import tempfile
from contextlib import redirect_stderr, redirect_stdout
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

from _bytes import damage, number, text
from _mcap import FIELDS, Record, assemble, pack_chunk, records, with_length, without_length
from matplotlib.figure import Figure
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import Attachment

from barc_sim.__main__ import main as barc
from barc_sim.bags import reader
from barc_sim.bags.recovery import recover
from barc_sim.figures import run_figures, side_view
from barc_sim.lab.report import page, read

if TYPE_CHECKING:
    from collections.abc import Callable
    from random import Random

#: Shares of bags: damaged wherever, finished, and with a footer that leads to the summary.
_ANYWHERE, _FINISHED, _MENDED = 0.2, 0.7, 0.8
#: Shares of fields: with a wrong length, and of chunks: with a checksum that is right.
_LYING, _CHECKED = 0.2, 0.8
_MOST = 16 << 20  # bytes that a record is repeated to

_DATA_END = bytes([Opcode.DATA_END])


@cache
def original() -> bytes:
    """Return the file of a short run, with a file of a student's attached."""
    with tempfile.TemporaryDirectory() as folder:
        options = ['--engine', 'local', '--realtime-factor', 'max', '--distance', '2']
        command = [sys.executable, '-m', 'barc_sim', 'acc', '-q', '--bag-dir', folder, *options]
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL)  # noqa: S603 (our own)
        (file,) = Path(folder).glob('*/*.mcap')
        content = file.read_bytes()
    attached = RecordBuilder()
    code = b'def bikeFE():\n    pass\n'
    Attachment(0, 0, 'student/bike_model.py', 'text/plain', code).write(attached)
    before = content.rindex(_DATA_END + (4).to_bytes(8, 'little'))
    return content[:before] + attached.end() + content[before:]


def damaged(chance: Random) -> tuple[str, str, bytes]:
    """Return the suffix of a file, what is damaged in it, and its content."""
    finished = chance.random() < _FINISHED
    found = list(records(original()))
    if not finished:
        found = found[: next(k for k, each in enumerate(found) if each.kind == Opcode.DATA_END)]
    if chance.random() < _ANYWHERE:
        return '.mcap', 'any bytes', damage(assemble(found, finished=finished), chance)
    kinds = {each.kind for outer in found for each in (outer, *outer.inner)}
    kind = chance.choice(sorted(kinds))
    for _ in range(chance.choice((1, 1, 2, 5))):
        holders = [each for each in found if kind in _kinds(each)]
        if not holders:  # the last one has become another kind
            break
        outer = chance.choice(holders)
        if outer.kind == kind:
            _damage_record(found, outer, chance)
        else:
            inner = chance.choice([each for each in outer.inner if each.kind == kind])
            _damage_record(outer.inner, inner, chance)
            compression = chance.choice((b'zstd', b'zstd', b'lz4', b''))
            pack_chunk(outer, compression, checked=chance.random() < _CHECKED)
    mended = finished and chance.random() < _MENDED
    content = assemble(found, finished=mended and kind != Opcode.FOOTER)
    return '.mcap', Record(kind, b'').name, content


def _kinds(record: Record) -> set[int]:
    return {record.kind, *(each.kind for each in record.inner)}


def _damage_record(among: list[Record], record: Record, chance: Random) -> None:
    """Damage a record's length, kind or place, or one of its fields."""
    at = next(k for k, each in enumerate(among) if each is record)
    match chance.randrange(12):
        case 0:
            record.length = chance.choice((0, 1, len(record.body) + 1, 1 << 31, (1 << 64) - 1))
        case 1:
            record.kind = chance.choice(sorted(FIELDS))
        case 2:
            count = chance.choice((1, 10, 1000))
            among[at:at] = [record] * min(count, _MOST // (len(record.body) + 1))
        case 3:
            del among[at]
            among.insert(chance.randrange(len(among) + 1), record)
        case 4:
            record.body = record.body[: chance.randrange(len(record.body) + 1)]
        case _ if fields := record.fields():
            name = chance.choice(sorted(fields))
            fields[name] = _damage_field(FIELDS[record.kind][name], fields[name], chance)
            record.body = b''.join(fields.values())
        case _:
            record.body = damage(record.body, chance)


def _damage_field(code: str, raw: bytes, chance: Random) -> bytes:
    if code in 'BHIQ':
        return number(code, raw, chance)
    if code == 'r':
        return damage(raw, chance)
    data = without_length(code, raw)
    if chance.random() < _LYING:
        length = raw[: len(raw) - len(data)]
        return number('Q' if code == 'D' else 'I', length, chance) + data
    if code == 'm' and chance.random() > _LYING:
        entries = _entries(data)
        key = chance.choice(entries)[0] if entries else b'road'
        changed = text(b'30.0', chance)
        entries += [(key, changed)] * chance.choice((1, 1, 3))
        return with_length('m', b''.join(with_length('s', x) for pair in entries for x in pair))
    return with_length(code, text(data, chance))


def _entries(data: bytes) -> list[tuple[bytes, bytes]]:
    texts = []
    while len(data) > 4:  # noqa: PLR2004 (a length and its text)
        size = int.from_bytes(data[:4], 'little')
        texts.append(data[4 : 4 + size])
        data = data[4 + size :]
    return list(zip(texts[::2], texts[1::2], strict=False))


def _plot(path: Path) -> None:
    shown = run_figures.settings(reader.info(path))
    run_figures.speed_figure(reader.read(path), title='', settings=shown, figure=Figure())


def _replay(path: Path) -> None:
    side_view.SideView(reader.read(path), Figure(figsize=side_view.SIZE), title='').update(0.1)


def _report(path: Path) -> None:
    page(read(path))


def _graph(path: Path) -> None:
    with redirect_stdout(io.StringIO()), redirect_stderr(io.StringIO()):
        barc(['graph', '--save', str(path.with_name('graph.svg')), '--bag', str(path)])


def uses(chance: Random) -> list[Callable[[Path], object]]:
    """Return what to do with a file, one after the other."""
    return [chance.choice((_plot, _replay, _report, _graph)), recover, reader.read]
