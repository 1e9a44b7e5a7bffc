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
import re
import socket
import subprocess
import sys
import tempfile
import time
from contextlib import redirect_stderr, redirect_stdout
from functools import cache, partial
from pathlib import Path
from typing import TYPE_CHECKING

from _bytes import damage, number, text
from _channels import channels, check_same
from _mcap import FIELDS, Record, assemble, pack_chunk, records, with_length, without_length
from matplotlib.figure import Figure
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import Attachment

from barc_sim.__main__ import main as barc
from barc_sim.bags import reader
from barc_sim.bags.convert import convert, recover
from barc_sim.errors import UserError
from barc_sim.figures import run_figures, views
from barc_sim.lab.run_report import page, read

if TYPE_CHECKING:
    from collections.abc import Callable
    from random import Random

#: Shares of bags: damaged wherever, finished, and with a footer that leads to the summary.
_ANYWHERE = 0.2
_FINISHED = 0.7
_MENDED = 0.8
#: Shares of bags: with other definitions of messages, and in a folder of more than plain files.
_DEFINED = 0.3
_SURROUNDED = 0.2
#: Shares of bags: with channels of other encodings, and of these: not damaged.
_FOREIGN = 0.3
_WHOLE = 0.5
#: Shares of fields: with a wrong length, and of chunks: with a checksum that is right.
_LYING = 0.2
_CHECKED = 0.8
_MOST = 16 << 20  # bytes that a record is repeated to

_FIELD = re.compile(r'(\s*)([\w/]+)(\S*)(\s+)(\w+)(.*)')
_TYPES = (
    *('bool', 'byte', 'int32', 'uint32', 'uint64', 'float32', 'float64', 'string', 'string<=9'),
    *('wstring', 'time', 'Header', 'std_msgs/Header', 'builtin_interfaces/Time', 'a/B', 'ECU'),
    *('barc_interfaces/ZDynBkMdl', 'barc_interfaces/ControllerState'),
)
_SIZES = ('', '', '[]', '[0]', '[1]', '[<=3]', '[1000]', '[400000000]', '[18446744073709551616]')
_NAMES = ('x', 'sec', 'stamp', 'header', 'names', 'values', 'a', 'class', 'saturated', 'X')

clock = time.process_time
_SCHEMA = Opcode.SCHEMA
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
    added: bytes = attached.end()  # type: ignore[no-untyped-call]
    return content[:before] + added + content[before:]


def damaged(chance: Random) -> tuple[str, str, bytes]:
    """Return the suffix of a file, what is damaged in it, and its content."""
    finished = chance.random() < _FINISHED
    base = original()
    if chance.random() < _FOREIGN:
        whole = chance.random() < _WHOLE
        base = channels(chance, whole=whole)
        if whole:
            return '.mcap', 'none: channels', base
    found = list(records(base))
    if not finished:
        found = found[: next(k for k, each in enumerate(found) if each.kind == Opcode.DATA_END)]
    if chance.random() < _ANYWHERE:
        return '.mcap', 'any bytes', damage(assemble(found, finished=finished), chance)
    if chance.random() < _DEFINED:
        _redefine(found, chance)
        return '.mcap', 'definitions', assemble(found, finished=finished)
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


def _redefine(found: list[Record], chance: Random) -> None:
    """Change the definition of a type, in the chunks and in the summary."""
    schemas = [each for outer in found for each in (outer, *outer.inner) if each.kind == _SCHEMA]
    if not schemas:
        return
    of = chance.choice(schemas).fields()['name']
    for record in schemas:
        fields = record.fields()
        if fields['name'] == of:
            text = without_length('d', fields['definition']).decode(errors='replace')
            changed = definition(text, chance).encode()
            record.body = b''.join((fields | {'definition': with_length('d', changed)}).values())
    for outer in found:
        if outer.inner:
            pack_chunk(outer, b'zstd', checked=True)


def definition(text: str, chance: Random) -> str:
    """Return a changed message definition."""
    lines = [line.partition('#')[0].rstrip() for line in text.splitlines()] or ['']
    for _ in range(chance.choice((1, 1, 1, 2, 5, 20))):
        at = chance.randrange(len(lines))
        kind = chance.choice(_TYPES) + chance.choice(_SIZES)
        field = _FIELD.match(lines[at])
        match chance.randrange(8):
            case 0 | 1 | 2 if field:
                lines[at] = field.expand(rf'\1{kind}\4\5')
            case 3 | 4:
                lines.insert(at, f'{kind} {chance.choice(_NAMES)}')
            case 5:
                lines[at:at] = [f'{kind} {chance.choice(_NAMES)}{k}' for k in range(500)]
            case 6:
                types = [f'MSG: a/B{k}\na/B{k + 1}{chance.choice(_SIZES)} a' for k in range(60)]
                lines += [line for each in types for line in ('=' * 80, *each.splitlines())]
                lines.insert(0, f'a/B0{chance.choice(_SIZES)} a')
            case _:
                del lines[at]
                lines = lines or ['']
    return '\n'.join(lines) + '\n'


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
    bag = reader.load(path)
    log = bag.log()
    shown = run_figures.settings(bag.info, log)
    run_figures.speed_figure(log, title='', settings=shown, figure=Figure())


def _replay(path: Path) -> None:
    views.SideView(reader.read(path), Figure(figsize=views.SIZE)).update(0.1)


def _report(path: Path) -> None:
    page(read(path))


def _graph(path: Path) -> None:
    with redirect_stdout(io.StringIO()), redirect_stderr(io.StringIO()):
        barc(['graph', '--save', str(path.with_name('graph.svg')), '--bag', str(path)])


_OUTSIDE = b'not of the bag'
_NEIGHBOURS = (
    *('run_0.mcap', 'run_1.mcap', 'metadata.yaml', '.metadata.yaml', '.run_0.mcap.part'),
    *('speed.png', '.speed.png', 'report.html', 'graph.svg', 'any'),
)


def _outside(path: Path) -> Path:
    return path.parent.with_name(f'{path.parent.name} outside')


def _bind(path: Path) -> None:
    with socket.socket(socket.AF_UNIX) as made:
        made.bind(str(path))


def _surround(path: Path, chance: Random) -> None:
    """Put what is no plain file beside the bag's file, or in its place."""
    outside = _outside(path)
    outside.mkdir()
    (outside / 'file').write_bytes(_OUTSIDE)
    makers: list[Callable[[Path], object]] = [
        *(partial(Path.symlink_to, target=outside / name) for name in ('', 'file', 'none')),
        *(partial(Path.symlink_to, target=name) for name in ('run_0.mcap', '/dev/zero', 'loop')),
        partial(os.link, outside / 'file'),
        *(os.mkfifo, Path.mkdir, _bind),
    ]
    for name in chance.sample(_NEIGHBOURS, chance.choice((1, 1, 2, 5))):
        place = path.with_name(name)
        place.unlink(missing_ok=True)
        chance.choice(makers)(place)


def _unchanged(path: Path) -> None:
    outside = _outside(path)
    names = [each.name for each in outside.iterdir()]
    if names != ['file'] or (outside / 'file').read_bytes() != _OUTSIDE:
        raise AssertionError(f'outside of the bag: {names}')


def _command(name: str, path: Path) -> None:
    error = io.StringIO()
    with redirect_stdout(io.StringIO()), redirect_stderr(error):
        code = barc([name, str(path.parent)])
    if code == 2:  # noqa: PLR2004 (a sentence)
        raise UserError(error.getvalue())


def _info(path: Path) -> None:
    _command('info', path)


def _convert(path: Path) -> None:
    convert(path, path.with_name('tables'))


def _recover(path: Path) -> None:
    whole = path.parent / 'whole'
    recover(path, whole)
    check_same(path, whole / 'whole_0.mcap')
    reader.read(whole)


def uses(chance: Random) -> list[Callable[[Path], object]]:
    """Return what to do with a file, one after the other."""
    if chance.random() < _SURROUNDED:
        os.environ.pop('DISPLAY', None)
        commands = chance.sample(('plot', 'report', 'recover'), 3)
        return [
            partial(_surround, chance=chance),
            *(partial(_command, name) for name in commands),
            _unchanged,
        ]
    return [chance.choice((_plot, _replay, _report, _graph, _info, _convert)), _recover]
