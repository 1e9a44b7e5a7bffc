"""Damaged bags: any bytes, and each field of each kind of record of the file's format, MCAP.

Message definitions are changed as texts of their own: types, lengths, names, types within types.
Some bags have channels with schemas and encodings of all kinds; of these, whole ones must be
recovered as they were.
In some folders links, named pipes, sockets, devices and folders stand in place of files.

Each bag goes through one of `plot`, `replay`, `report`, `graph`, `info` and `convert`, and through
`recover`; what that leaves is read again. Nothing outside of the bag may change.
"""

from __future__ import annotations

import io
import os
import subprocess
import sys
import tempfile
import time
from contextlib import redirect_stderr, redirect_stdout
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

from _bytes import damage, number, text
from _channels import channels, check_same
from _definitions import changed_definition
from _mcap import (
    FIELDS,
    Record,
    assemble,
    pack_chunk,
    records,
    with_inner,
    with_length,
    without_length,
)
from _surroundings import check_outside, surround
from matplotlib.figure import Figure
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import Attachment

from barc_sim.__main__ import main as barc
from barc_sim.bags import reader
from barc_sim.bags.convert import convert
from barc_sim.bags.recovery import recover
from barc_sim.errors import UserError
from barc_sim.figures import run_figures, views
from barc_sim.lab.run_report import page, read

if TYPE_CHECKING:
    from collections.abc import Callable
    from random import Random

#: Shares of bags: damaged at any byte, finished, and with a footer that leads to the summary.
_ANY_BYTES = 0.2
_FINISHED = 0.7
_WITH_FOOTER = 0.8
#: Shares of bags: with other definitions of messages, and in a folder of more than plain files.
_DEFINITIONS = 0.3
_SURROUNDED = 0.2
#: Shares of bags: with channels of other encodings, and of these: not damaged.
_FOREIGN = 0.3
_WHOLE = 0.5
#: Shares of fields: with a wrong length, and of chunks: with a checksum that is right.
_WRONG_LENGTH = 0.2
_CHECKSUM = 0.8
_MAX_REPEATED_SIZE = 16 << 20  # bytes that a record is repeated to

clock = time.process_time
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

    builder = RecordBuilder()
    code = b'def bikeFE():\n    pass\n'
    Attachment(0, 0, 'student/bike_model.py', 'text/plain', code).write(builder)
    attachment: bytes = builder.end()  # type: ignore[no-untyped-call]

    end_of_data = content.rindex(_DATA_END + (4).to_bytes(8, 'little'))
    return content[:end_of_data] + attachment + content[end_of_data:]


def damaged_file(chance: Random) -> tuple[str, str, bytes]:
    """Return the suffix of a file, what is damaged in it, and its content."""
    finished = chance.random() < _FINISHED
    base = original()
    if chance.random() < _FOREIGN:
        whole = chance.random() < _WHOLE
        base = channels(chance, whole=whole)
        if whole:
            return '.mcap', 'none: channels', base

    file_records = list(records(base))
    if not finished:
        kinds = [record.kind for record in file_records]
        del file_records[kinds.index(Opcode.DATA_END) :]
    if chance.random() < _ANY_BYTES:
        content = assemble(file_records, finished=finished)
        return '.mcap', 'any bytes', damage(content, chance)
    if chance.random() < _DEFINITIONS:
        _change_definition(file_records, chance)
        return '.mcap', 'definitions', assemble(file_records, finished=finished)

    kind = chance.choice(sorted({record.kind for record in with_inner(file_records)}))
    for _ in range(chance.choice((1, 1, 2, 5))):
        _damage_one_of(file_records, kind, chance)
    has_footer = finished and chance.random() < _WITH_FOOTER
    content = assemble(file_records, finished=has_footer and kind != Opcode.FOOTER)
    return '.mcap', Record(kind, b'').name, content


def _change_definition(file_records: list[Record], chance: Random) -> None:
    """Change the definition of a type, in the chunks and in the summary."""
    schemas = [record for record in with_inner(file_records) if record.kind == Opcode.SCHEMA]
    if not schemas:
        return

    type_name = chance.choice(schemas).fields()['name']
    for record in schemas:
        fields = record.fields()
        if fields['name'] == type_name:
            text = without_length('d', fields['definition']).decode(errors='replace')
            changed = changed_definition(text, chance).encode()
            fields['definition'] = with_length('d', changed)
            record.body = b''.join(fields.values())

    for outer in file_records:
        if outer.inner:
            pack_chunk(outer, b'zstd', checked=True)


def _damage_one_of(file_records: list[Record], kind: int, chance: Random) -> None:
    """Damage a record of a kind; none if the last one has become another kind."""
    holders = [record for record in file_records if kind in _kinds(record)]
    if not holders:
        return

    outer = chance.choice(holders)
    if outer.kind == kind:
        _damage_record(file_records, outer, chance)
        return
    inner = chance.choice([record for record in outer.inner if record.kind == kind])
    _damage_record(outer.inner, inner, chance)
    compression = chance.choice((b'zstd', b'zstd', b'lz4', b''))
    pack_chunk(outer, compression, checked=chance.random() < _CHECKSUM)


def _kinds(record: Record) -> set[int]:
    return {each.kind for each in with_inner([record])}


def _damage_record(neighbours: list[Record], record: Record, chance: Random) -> None:
    """Damage a record's length, kind or place, or one of its fields."""
    at = next(place for place, neighbour in enumerate(neighbours) if neighbour is record)
    match chance.randrange(12):
        case 0:
            record.length = chance.choice((0, 1, len(record.body) + 1, 1 << 31, (1 << 64) - 1))
        case 1:
            record.kind = chance.choice(sorted(FIELDS))
        case 2:
            count = chance.choice((1, 10, 1000))
            max_count = _MAX_REPEATED_SIZE // (len(record.body) + 1)
            neighbours[at:at] = [record] * min(count, max_count)
        case 3:
            del neighbours[at]
            neighbours.insert(chance.randrange(len(neighbours) + 1), record)
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
    if chance.random() < _WRONG_LENGTH:
        length = raw[: len(raw) - len(data)]
        return number('Q' if code == 'D' else 'I', length, chance) + data
    if code == 'm' and chance.random() > _WRONG_LENGTH:
        return with_length('m', _damage_map(data, chance))
    return with_length(code, text(data, chance))


def _damage_map(data: bytes, chance: Random) -> bytes:
    """Return a map with another value for one of its keys, once or often."""
    texts = _texts(data)
    key = chance.choice(texts[::2]) if texts else b'road'
    value = text(b'30.0', chance)
    texts += [key, value] * chance.choice((1, 1, 3))
    return b''.join(with_length('s', part) for part in texts)


def _texts(data: bytes) -> list[bytes]:
    """Return the keys and values of a map, in turns, without a key that has no value."""
    texts = []
    while len(data) > 4:  # noqa: PLR2004 (a length and its text)
        size = int.from_bytes(data[:4], 'little')
        texts.append(data[4 : 4 + size])
        data = data[4 + size :]
    pairs = len(texts) // 2
    return texts[: 2 * pairs]


def uses(chance: Random) -> list[Callable[[Path], object]]:
    """Return what to do with a file, one after the other."""
    if chance.random() < _SURROUNDED:
        os.environ.pop('DISPLAY', None)
        steps = chance.sample((_plot_command, _report_command, _recover_command), 3)
        return [lambda path: surround(path, chance), *steps, check_outside]
    return [chance.choice((_plot, _replay, _report, _graph, _info, _convert)), _recover]


def _plot(path: Path) -> None:
    bag = reader.load(path)
    log = bag.log()
    settings = run_figures.settings(bag.info, log)
    run_figures.speed_figure(log, title='', settings=settings, figure=Figure())


def _replay(path: Path) -> None:
    views.SideView(reader.read(path), Figure(figsize=views.SIZE)).update(0.1)


def _report(path: Path) -> None:
    page(read(path))


def _graph(path: Path) -> None:
    with redirect_stdout(io.StringIO()), redirect_stderr(io.StringIO()):
        barc(['graph', '--save', str(path.with_name('graph.svg')), '--bag', str(path)])


def _info(path: Path) -> None:
    _run_command('info', path)


def _convert(path: Path) -> None:
    convert(path, path.with_name('tables'))


def _recover(path: Path) -> None:
    whole = path.parent / 'whole'
    recover(path, whole)
    check_same(path, whole / 'whole_0.mcap')
    reader.read(whole)


def _plot_command(path: Path) -> None:
    _run_command('plot', path)


def _report_command(path: Path) -> None:
    _run_command('report', path)


def _recover_command(path: Path) -> None:
    _run_command('recover', path)


def _run_command(name: str, path: Path) -> None:
    error = io.StringIO()
    with redirect_stdout(io.StringIO()), redirect_stderr(error):
        code = barc([name, str(path.parent)])
    if code == 2:  # noqa: PLR2004 (a sentence)
        raise UserError(error.getvalue())
