"""Bags of rosbag2, of each version: split, compressed, in sqlite3 and MCAP, whole and damaged."""

from __future__ import annotations

import json
import random
import shutil
import sqlite3
import tempfile
from contextlib import closing, suppress
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest
import zstandard
from command_line import printed, refused
from made_bags import make
from rosbag2_layouts import (
    CUSTOM_DATA,
    LAYOUTS,
    Sent,
    write_bag,
    write_bomb,
    write_endless_database,
)
from rosbags.convert.converter import convert

from barc_sim.bags import reader
from barc_sim.bags.bag_files import files
from barc_sim.bags.contents import Contents
from barc_sim.bags.convert import log_of_fields
from barc_sim.bags.mcap_files import McapFile
from barc_sim.bags.recovery import recover
from barc_sim.errors import UserError
from barc_sim.simulation.closed_loop import closed_loop

if TYPE_CHECKING:
    from collections.abc import Iterator

    from barc_sim.bags.messages import BagMessage

SECOND = 10**9
START = 1_700_000_000 * SECOND
#: Three files; the messages at each end of a file overlap in time with those of the next.
FILES = [
    [
        Sent(('/a', '/b')[k % 2], START + 10**8 * (10 * number + k + (k == 9)), f'{number} {k}')
        for k in range(10)
    ]
    for number in range(3)
]
SENT = [message for file in FILES for message in file]
IN_ORDER = sorted(SENT, key=lambda message: message.received)
CASES = [
    (distribution, storage, compression)
    for distribution, layout in LAYOUTS.items()
    for storage in layout.storages
    for compression in (['', 'file', 'message'] if layout.is_compressing else [''])
]


def received(path: Path, start: int | None = None) -> list[Sent]:
    """Return the messages of a bag, in order of reception."""
    found = []
    for message in Contents(path).in_order(start):
        word = message.data[8:].decode().rstrip('\0')
        found.append(Sent(message.topic.name, message.received, word))
        assert message.data == found[-1].data
    return found


@pytest.mark.parametrize(('distribution', 'storage', 'compression'), CASES)
def test_a_split_bag_of_each_distribution_is_read_as_one(
    tmp_path: Path, distribution: str, storage: str, compression: str
) -> None:
    path = write_bag(tmp_path / 'drive', FILES, distribution, storage, compression)
    assert received(path) == IN_ORDER
    middle = IN_ORDER[17].received
    assert received(path, middle) == IN_ORDER[17:]

    described = json.loads(printed('info', str(path), '--json'))
    assert described['messages'] == 30
    assert described['damages'] == {}
    assert described['duration'] == 3.0
    assert {topic['type'] for topic in described['topics']} == {'std_msgs/msg/String'}
    has_custom_data = LAYOUTS[distribution].version >= 6
    assert described['metadata'] == (CUSTOM_DATA if has_custom_data else {})
    spans = described['file_spans']
    assert [*spans] == [file.name for file in files(path)]
    assert [span['messages'] for span in spans.values()] == [10, 10, 10]
    assert [span['start'] for span in spans.values()] == [START / SECOND + k for k in range(3)]
    (first, *_) = Contents(path).topics
    (qos,) = first.offered_qos or [{'durability': None}]
    assert qos['durability'] in {'transient_local', 1, None}

    printed('convert', str(path), '-o', str(tmp_path / 'csv'))
    rows = (tmp_path / 'csv' / 'a.csv').read_text().splitlines()[1:]
    words = [row.rpartition(',')[2] for row in rows]
    assert words == [message.word for message in IN_ORDER if message.topic == '/a']


@pytest.mark.parametrize(('distribution', 'storage', 'compression'), CASES)
def test_every_message_before_a_time_is_in_a_block(
    tmp_path: Path, distribution: str, storage: str, compression: str
) -> None:
    path = write_bag(tmp_path / 'drive', FILES, distribution, storage, compression)
    end = IN_ORDER[17].received
    contents = Contents(path)
    blocks = [[*block] for block in contents.blocks_before(end, lambda *_: True)]
    messages = [message for block in reversed(blocks) for message in block]
    words = [message.data[8:].decode().rstrip('\0') for message in messages]
    expected = [message.word for message in SENT if message.received < end]
    assert [word for word in words if word in expected] == expected
    assert not [*contents.blocks_before(end, lambda *_: False)]


LOG = closed_loop(distance=3.0)


@pytest.mark.parametrize('storage', ['mcap', 'sqlite3'])
@pytest.mark.parametrize('compression', [None, 'file', 'message'])
def test_a_run_that_was_converted_reads_as_the_run(
    tmp_path: Path, storage: str, compression: str | None
) -> None:
    run = make(tmp_path / 'run', LOG)
    made = tmp_path / 'made'
    packing = 'zstd' if compression else None
    convert([run], made, storage, 9, packing, compression, None, None, (), (), (), ())
    log = reader.read(made)
    expected = reader.read(run)
    for name in ('t', 'x', 'v_x', 'motor', 'theta_deg', 'proportional'):
        np.testing.assert_array_equal(log.columns()[name], expected.columns()[name])
    fields = {'v_x': '/z_vhcl.v_x', 'motor': '/ecu.motor'}
    speeds = log_of_fields(made, fields).v_x
    np.testing.assert_array_equal(speeds, log_of_fields(run, fields).v_x)
    assert reader.newest(tmp_path) in {run, made}
    shutil.rmtree(run)
    assert reader.newest(tmp_path) == made


def test_info_prints_each_file_of_a_split_bag(tmp_path: Path) -> None:
    lines = printed('info', str(write_bag(tmp_path / 'drive', FILES))).splitlines()
    for number, line in enumerate(lines[:3]):
        title = ' ' * 10 if number else 'Files:    '
        assert line.startswith(f'{title} drive_{number}.mcap: ')
        assert line.endswith(f' ({START // SECOND + number}.000000000), 1.000000000 s, 10 messages')
    assert lines[3].startswith('Bag size: ')


def test_info_prints_exact_nanoseconds_and_files_without_messages(tmp_path: Path) -> None:
    path = write_bag(tmp_path / 'drive', [[Sent('/a', START + 397_611, 'a')], [SENT[-1]]])
    (path / 'drive_1.mcap').write_bytes(b'')
    lines = printed('info', str(path)).splitlines()
    assert f' ({START // SECOND}.000397611), ' in lines[0]
    assert lines[1].strip() == 'drive_1.mcap: no messages'


@pytest.mark.parametrize('compression', ['', 'file', 'message'])
@pytest.mark.parametrize('storage', ['mcap', 'sqlite3'])
@pytest.mark.parametrize('version', [8, 9])
def test_what_rosbags_writes_is_read(
    tmp_path: Path, version: int, storage: str, compression: str
) -> None:
    source = write_bag(tmp_path / 'source', FILES)
    mode = compression or None
    packing = 'zstd' if compression else None
    made = tmp_path / 'made'
    convert([source], made, storage, version, packing, mode, None, None, (), (), (), ())
    assert received(made) == IN_ORDER


@pytest.mark.parametrize('storage', ['mcap', 'sqlite3'])
@pytest.mark.parametrize('compression', ['', 'file'])
def test_a_single_file_is_read_alone(tmp_path: Path, storage: str, compression: str) -> None:
    path = write_bag(tmp_path / 'drive', FILES, storage=storage, compression=compression)
    second = files(path)[1]
    lone = tmp_path / second.name
    shutil.copy(second, lone)
    assert received(lone) == FILES[1]


def names(path: Path) -> list[str]:
    return [file.name for file in files(path)]


def touched(folder: Path, *present: str, metadata: str | None = None) -> Path:
    """Return a folder with empty files."""
    folder.mkdir()
    for name in present:
        (folder / name).touch()
    if metadata is not None:
        text = f'rosbag2_bagfile_information:\n  version: 5\n{metadata}\n  files: []\n'
        (folder / 'metadata.yaml').write_text(text)
    return folder


ENTRY = '  relative_file_paths:\n'


@pytest.mark.parametrize(
    ('present', 'metadata', 'expected'),
    [
        (['x_10.mcap', 'x_9.mcap'], None, ['x_9.mcap', 'x_10.mcap']),
        (['x_10.mcap', 'x_9.mcap'], '', ['x_9.mcap', 'x_10.mcap']),
        (['a.db3', 'b.db3'], ENTRY + '    - b.db3\n    - a.db3', ['b.db3', 'a.db3']),
        (['a.db3', 'b.db3'], ENTRY + '  - b.db3\n  - a.db3', ['b.db3', 'a.db3']),
        (['a.db3', 'b.db3'], '  relative_file_paths: [b.db3, a.db3]', ['b.db3', 'a.db3']),
        (['a.db3', 'b.db3'], ENTRY + '    - x/b.db3\n    - x/a.db3', ['b.db3', 'a.db3']),
        (['a.db3', 'b.db3'], ENTRY + '    - ../../b.db3\n    - /etc/a.db3', ['b.db3', 'a.db3']),
        (['a.db3', 'b.db3'], ENTRY + '    - C:\\x\\b.db3\n    - a.db3', ['b.db3', 'a.db3']),
        (['x_2.db3', 'x_1.db3'], ENTRY + '    - x_0.db3', ['x_1.db3', 'x_2.db3']),
        (['x_1.db3', 'x_0.db3'], ENTRY + '    - x_0.db3', ['x_0.db3', 'x_1.db3']),
        (['x_0.mcap', 'x_0.db3'], None, ['x_0.mcap']),
        (['x_0.mcap', 'x_0.db3'], ENTRY + '    - x_0.db3', ['x_0.db3']),
        (['x_0.db3', 'x_0.db3.zstd'], None, ['x_0.db3']),
        (['x_0.db3', 'x_0.db3.zstd'], ENTRY + '    - x_0.db3.zstd', ['x_0.db3.zstd']),
        (['x_1.db3', 'x_0.db3.zstd'], None, ['x_0.db3.zstd', 'x_1.db3']),
        (['x_1.db3', 'x_0.db3'], '  relative_file_paths: {x_1.db3: 1}', ['x_0.db3', 'x_1.db3']),
        (['x_1.db3', 'x_0.db3'], '  relative_file_paths: [', ['x_0.db3', 'x_1.db3']),
        (['x_1.db3', 'x_0.db3'], '  relative_file_paths:x', ['x_0.db3', 'x_1.db3']),
        (['.x_1.mcap', 'x_0.mcap', 'x_0.mcap.part', 'notes.txt'], None, ['x_0.mcap']),
    ],
)
def test_files_are_in_the_order_of_metadata_or_else_of_their_numbers(
    tmp_path: Path, present: list[str], metadata: str | None, expected: list[str]
) -> None:
    assert names(touched(tmp_path / 'x', *present, metadata=metadata)) == expected


def test_a_long_metadata_of_a_days_recording_still_orders_the_files(tmp_path: Path) -> None:
    present = [f'part{k:04}.mcap' for k in reversed(range(1440))]
    entry = ENTRY + ''.join(f'    - {name}\n' for name in present)
    long = '  custom_data:\n    note: ' + 'x' * 300_000
    path = touched(tmp_path / 'x', *present, metadata=entry + long)
    assert names(path) == present


@pytest.mark.parametrize('metadata', ['missing', 'empty', 'of the first files'])
@pytest.mark.parametrize('storage', ['mcap', 'sqlite3'])
def test_the_bag_of_a_killed_recorder_is_read_with_its_last_file(
    tmp_path: Path, storage: str, metadata: str
) -> None:
    path = write_bag(tmp_path / 'drive', FILES, storage=storage)
    file = path / 'metadata.yaml'
    if metadata == 'missing':
        file.unlink()
    elif metadata == 'empty':
        file.write_text('')
    else:
        shutil.copy(write_bag(tmp_path / 'first', FILES[:2]) / 'metadata.yaml', file)
        file.write_text(file.read_text().replace('first', 'drive'))
    assert received(path) == IN_ORDER


def test_of_a_killed_recording_only_the_last_file_is_read_for_its_time_span(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = write_bag(tmp_path / 'drive', FILES)
    last = files(path)[-1]
    last.write_bytes(last.read_bytes()[:-300])
    contents = Contents(path)
    read: list[Path] = []
    messages = McapFile.messages

    def noted(file: McapFile, start: int | None = None) -> Iterator[BagMessage]:
        read.append(file.path)
        return messages(file, start)

    monkeypatch.setattr(McapFile, 'messages', noted)
    contents.complete()
    contents.complete()
    assert read == [last]
    assert contents.span.count == 30
    assert contents.span.end == START + 10**8 * 30


@pytest.mark.parametrize('storage', ['mcap', 'sqlite3'])
@pytest.mark.parametrize('content', [b'', b'\x89MC'])
def test_a_file_that_was_only_begun_is_damage(tmp_path: Path, storage: str, content: bytes) -> None:
    path = write_bag(tmp_path / 'drive', FILES, storage=storage)
    last = files(path)[-1]
    last.write_bytes(content)
    described = json.loads(printed('info', str(path), '--json'))
    assert described['messages'] == 20
    assert {*described['damages']} == {last.name}


@pytest.mark.parametrize('compression', ['', 'file'])
def test_the_damaged_last_file_of_mcap_is_read_as_far_as_it_is_whole(
    tmp_path: Path, compression: str
) -> None:
    path = write_bag(tmp_path / 'drive', FILES, compression=compression)
    last = files(path)[-1]
    if compression:
        whole = zstandard.decompress(last.read_bytes())
        last.write_bytes(zstandard.compress(whole[:-300]))
    else:
        last.write_bytes(last.read_bytes()[:-300])
    contents = Contents(path)
    assert sum(1 for _ in contents.messages()) == 30
    assert contents.damages[last.name].unfinished


def test_a_compressed_file_cut_short_is_damage(tmp_path: Path) -> None:
    words = [Sent('/a', START + k, f'word {k * k}') for k in range(20_000)]
    path = write_bag(tmp_path / 'drive', [FILES[0], words], compression='file')
    last = files(path)[-1]
    last.write_bytes(last.read_bytes()[: last.stat().st_size // 2])
    contents = Contents(path)
    contents.read_all()
    assert contents.span.count >= 10
    assert contents.damages[last.name].unfinished


def database_in(folder: Path, count: int, *pragmas: str) -> tuple[Path, sqlite3.Connection]:
    """Return a bag of sqlite3 of `count` messages more, which its recorder still has open."""
    path = write_bag(folder, [FILES[0]], storage='sqlite3')
    (file,) = files(path)
    database = sqlite3.connect(file)
    for pragma in pragmas:
        database.execute(f'PRAGMA {pragma}')
    for k in range(count):
        data = Sent('/a', 0, f'{k}' * 300).data
        row = (START + SECOND * 10 + k, data)
        database.execute('INSERT INTO messages(topic_id, timestamp, data) VALUES (1, ?, ?)', row)
    return path, database


def test_what_a_killed_recorder_left_in_its_write_ahead_log_is_read(tmp_path: Path) -> None:
    path, database = database_in(tmp_path / 'live', 5000, 'journal_mode = WAL')
    database.commit()
    with closing(database):
        assert [*path.glob('*-wal')]
        killed = tmp_path / 'killed'
        shutil.copytree(path, killed, ignore=lambda *_: ['live_0.db3-shm', 'metadata.yaml'])
    before = {file.name: file.read_bytes() for file in killed.iterdir()}

    contents = Contents(killed)
    assert sum(1 for _ in contents.messages()) == 5010
    assert contents.damages == {}
    assert {file.name: file.read_bytes() for file in killed.iterdir()} == before
    assert not [*Path(tempfile.gettempdir()).glob('barc_*/live_0.db3')]


def test_an_empty_write_ahead_log_costs_no_copy(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = write_bag(tmp_path / 'drive', FILES, storage='sqlite3')
    for file in files(path):
        file.with_name(file.name + '-wal').touch()
    monkeypatch.setattr('barc_sim.bags.sqlite.SqliteFile._copy', None)
    assert received(path) == IN_ORDER


def test_a_transaction_that_a_killed_recorder_did_not_end_is_rolled_back(tmp_path: Path) -> None:
    path, database = database_in(tmp_path / 'live', 5000, 'cache_size = 10')
    with closing(database):
        assert [*path.glob('*-journal')]
        killed = tmp_path / 'killed'
        shutil.copytree(path, killed)
    assert received(killed) == FILES[0]


def test_a_journal_that_names_another_file_is_not_followed(tmp_path: Path) -> None:
    """By such a journal sqlite removes the file, as of a transaction of two databases."""
    path, database = database_in(tmp_path / 'live', 5000, 'cache_size = 10')
    with closing(database):
        killed = tmp_path / 'killed'
        shutil.copytree(path, killed)
    victim = tmp_path / 'victim'
    victim.write_text('precious')
    name = str(victim).encode()
    with (killed / 'live_0.db3-journal').open('r+b') as journal:
        content = journal.read()
        page_size = int.from_bytes(content[24:28], 'big')
        journal.seek(0, 2)
        checksum = sum(name) & 0xFFFF_FFFF
        record = (2**30 // page_size + 1).to_bytes(4, 'big') + name
        record += len(name).to_bytes(4, 'big') + checksum.to_bytes(4, 'big')
        journal.write(record + bytes.fromhex('d9d505f920a163d7'))
    assert 'names another file' in refused('info', str(killed))
    assert victim.exists()


def test_a_damaged_page_of_sqlite3_costs_its_messages_alone(tmp_path: Path) -> None:
    path, database = database_in(tmp_path / 'live', 5000)
    database.commit()
    database.close()
    (file,) = files(path)
    content = bytearray(file.read_bytes())
    middle = len(content) // 8192 * 4096
    content[middle : middle + 8192] = bytes(8192)
    file.write_bytes(content)
    contents = Contents(path)
    count = sum(1 for _ in contents.messages())
    assert 4500 < count < 5010
    assert contents.damages[file.name].unfinished

    file.write_bytes(content[:middle])  # its end is missing, too
    contents = Contents(path)
    count = sum(1 for _ in contents.messages())
    assert 1500 < count < 3500
    assert contents.damages[file.name].unfinished


@pytest.mark.parametrize(
    ('kind', 'data'),
    [
        ('geometry_msgs/msg/Twist', bytes(48)),  # in Humble's own packages
        ('barc_interfaces/msg/ECU', bytes([*bytes(8), 1, *bytes(23)])),  # in an installed one
        ('nobody/msg/Level', b''),
    ],
)
@pytest.mark.parametrize('distribution', ['foxy', 'humble'])
def test_a_type_that_an_old_bag_does_not_define_has_the_known_definition(
    tmp_path: Path, distribution: str, kind: str, data: bytes
) -> None:
    path = write_bag(tmp_path / 'old', [FILES[0]], distribution, 'sqlite3')
    (file,) = files(path)
    with closing(sqlite3.connect(file)) as database:
        database.execute('UPDATE topics SET type = ?', [kind])
        database.execute('UPDATE messages SET data = ?', [b'\0\1\0\0' + data])
        database.commit()
    assert f'        5 /a [{kind}]' in printed('info', str(path)).splitlines()
    contents = Contents(path)
    assert all(bool(topic.definition) == bool(data) for topic in contents.topics)
    if data:
        printed('convert', str(path), '-o', str(tmp_path / 'csv'))
    else:
        line = refused('convert', str(path), '-o', str(tmp_path / 'csv'))
        assert 'has no message that can be converted' in line


def test_a_file_that_is_no_database_is_refused_in_one_sentence(tmp_path: Path) -> None:
    (tmp_path / 'a.db3').write_bytes(b'no database')
    assert 'is not a bag in sqlite3 (file is not a database)' in refused(
        'info', str(tmp_path / 'a.db3')
    )
    (tmp_path / 'b.db3').touch()
    assert 'is not a bag in sqlite3 (it has no table' in refused('info', str(tmp_path / 'b.db3'))


@pytest.mark.parametrize(
    'statements',
    [
        """CREATE VIEW topics AS SELECT 1 id, '/a' name, 'a/msg/B' type, 'cdr'
          serialization_format; CREATE VIEW messages AS WITH RECURSIVE n(topic_id, timestamp, data)
          AS (SELECT 1, 1, zeroblob(9000) UNION ALL SELECT 1, timestamp + 1, data FROM n)
          SELECT * FROM n""",
        """CREATE TABLE topics(id, name, type, serialization_format);
          CREATE TABLE messages(topic_id, timestamp,
          data BLOB GENERATED ALWAYS AS (zeroblob(900000000)))""",
        """CREATE TABLE topics(id, name, type, serialization_format);
          CREATE VIRTUAL TABLE messages USING fts5(topic_id, timestamp, data)""",
    ],
    ids=['view', 'computed column', 'virtual table'],
)
def test_a_database_that_computes_its_rows_is_refused(tmp_path: Path, statements: str) -> None:
    with closing(sqlite3.connect(tmp_path / 'a.db3')) as database:
        database.executescript(statements)
    with pytest.raises(UserError, match=r'it has no table \'(topics|messages)\' of rosbag2'):
        Contents(tmp_path)


@pytest.mark.parametrize('compression', ['', 'file', 'message'])
@pytest.mark.parametrize('storage', ['mcap', 'sqlite3'])
def test_any_damage_leaves_messages_or_one_sentence(
    tmp_path: Path, storage: str, compression: str
) -> None:
    whole = write_bag(tmp_path / 'whole', FILES, storage=storage, compression=compression)
    chance = random.Random(7)  # noqa: S311 (no secret)
    for trial in range(15):
        path = tmp_path / f'damaged {trial}'
        shutil.copytree(whole, path)
        for file in files(path):
            content = bytearray(file.read_bytes())
            for _ in range(chance.choice([0, 1, 20])):
                content[chance.randrange(len(content))] = chance.randrange(256)
            file.write_bytes(content[: chance.choice([len(content), chance.randrange(8000)])])
        with suppress(UserError):
            recover(path, tmp_path / f'recovered {trial}')
            recovered = Contents(tmp_path / f'recovered {trial}')
            recovered.read_all()
            assert not recovered.damages


def test_pages_that_refer_to_one_another_have_an_end(tmp_path: Path) -> None:
    path = tmp_path / 'drive'
    write_endless_database(path)
    assert 'unpacks to more than a recording of its size can hold' in refused('info', str(path))


def test_a_link_in_the_folder_is_refused(tmp_path: Path) -> None:
    target = write_bag(tmp_path / 'other', [FILES[0]], storage='sqlite3')
    folder = tmp_path / 'drive'
    folder.mkdir()
    (folder / 'drive_0.db3').symlink_to(target / 'other_0.db3')
    assert 'is a link' in refused('info', str(folder))


@pytest.mark.parametrize('suffix', ['mcap', 'db3'])
def test_a_compressed_file_that_unpacks_to_too_much_is_refused(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / 'bomb'
    write_bomb(path, suffix)
    assert 'unpacks to more than a recording of its size can hold' in refused('info', str(path))


def test_a_disk_without_space_for_a_copy_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = write_bag(tmp_path / 'drive', FILES, storage='sqlite3', compression='file')
    full = type('Usage', (), {'free': 5 << 20})
    monkeypatch.setattr('barc_sim.bags.sqlite.shutil.disk_usage', lambda _: full)
    assert 'has only 5 MiB free: name a folder on a larger disk in TMPDIR' in refused(
        'info', str(path)
    )
