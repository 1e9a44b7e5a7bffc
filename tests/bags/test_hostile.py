"""Bags that are made to harm: each command ends soon, with a result or a sentence."""

from __future__ import annotations

import json
import os
import struct
import subprocess
import sys
import tracemalloc
from dataclasses import replace
from typing import TYPE_CHECKING

import pytest
import zstandard
from command_line import ENVIRONMENT
from made_bags import PARAMETERS, PERIOD, encoded, fill, make
from mcap.writer import CompressionType, Writer
from rosbag2_layouts import write_bomb, write_endless_database

from barc_sim.__main__ import main as barc
from barc_sim.bags import reader
from barc_sim.bags.writer import BagWriter
from barc_sim.interfaces.definitions import definition
from barc_sim.interfaces.topics import LOG_TYPES, STATE
from barc_sim.simulation.closed_loop import closed_loop

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

COMMANDS = ('plot', 'report', 'graph', 'info', 'recover')
SECONDS = 20.0  # of processor time: reading may take 9, which a busy machine counts more
MEMORY = 300 << 20  # bytes
LOG = closed_loop(distance=2.0)
SCHEMA = definition(LOG_TYPES[STATE])


def bag(path: Path, metadata: dict[str, str] | None = None, **attachments: bytes) -> None:
    make(path, LOG, metadata, attachments)


def with_metadata(name: str, text: str) -> Callable[[Path], None]:
    return lambda path: bag(path, {name: text})


def file_of(
    path: Path, messages: list[tuple[int, bytes]], schema: str = SCHEMA, **metadata: str
) -> None:
    """Write a bag of one chunk of states, with the channel's metadata."""
    path.mkdir()
    with (path / 'run_0.mcap').open('wb') as stream:
        writer = Writer(stream, chunk_size=1 << 40, compression=CompressionType.ZSTD)
        writer.start(profile='ros2')
        number = writer.register_schema(LOG_TYPES[STATE], 'ros2msg', schema.encode())
        channel = writer.register_channel('/' + STATE, 'cdr', number, metadata)
        for k, data in messages:
            writer.add_message(channel, k, data, k, 0)
        writer.finish()  # type: ignore[no-untyped-call]


def alias_bomb(path: Path) -> None:
    bomb = 'a0: &a0 [x, x]\n' + ''.join(
        f'a{k}: &a{k} [{", ".join([f"*a{k - 1}"] * 10)}]\n' for k in range(1, 12)
    )
    file_of(path, [(0, encoded(LOG, 0, STATE))], offered_qos_profiles=f'- {{{bomb}}}')


def one_stamp_far_off(path: Path) -> None:
    far = bytearray(encoded(LOG, 1, STATE))
    far[4:8] = struct.pack('<i', 2_000_000_000)
    file_of(path, [(0, encoded(LOG, 0, STATE)), (PERIOD, bytes(far))])


def chunk_of(path: Path, content: bytes, size: int, compression: str = 'zstd') -> None:
    """Write a bag of one chunk with any content."""
    name = compression.encode()
    body = struct.pack('<QQQII', 0, 0, size, 0, len(name)) + name
    body += struct.pack('<Q', len(content)) + content
    path.mkdir()
    with (path / 'run_0.mcap').open('wb') as stream:
        Writer(stream).start(profile='ros2')
        stream.write(b'\x06' + struct.pack('<Q', len(body)) + body)


def zstd_bomb(path: Path) -> None:
    compressor = zstandard.ZstdCompressor().compressobj(size=2 << 30)
    parts = [compressor.compress(bytes(64 << 20)) for _ in range(32)]
    chunk_of(path, b''.join([*parts, compressor.flush()]), 64)


def many_messages(path: Path) -> None:
    data = encoded(LOG, 0, STATE)
    record = struct.pack('<HIQQ', 1, 0, 0, 0) + data
    whole = (b'\x05' + struct.pack('<Q', len(record)) + record) * 300_000
    chunk_of(path, zstandard.compress(whole), len(whole))


def defined(name: str, fields: str, data: bytes = b'') -> Callable[[Path], None]:
    """Return a maker of a bag whose state has another definition, with a message of its own."""
    schema = SCHEMA.replace(name, fields)
    assert schema != SCHEMA
    return lambda path: file_of(path, [(0, data or encoded(LOG, 0, STATE))], schema)


def failing_chunks(path: Path) -> None:
    """Write chunks that unpack to much and have a wrong checksum."""
    size = 32 << 20
    content = zstandard.compress(bytes(size))
    body = struct.pack('<QQQII', 0, 0, size, 1, 4) + b'zstd' + struct.pack('<Q', len(content))
    records(path, (b'\x06' + struct.pack('<Q', len(body) + len(content)) + body + content) * 400)


def records(path: Path, content: bytes) -> None:
    """Write a bag of these records."""
    path.mkdir()
    with (path / 'run_0.mcap').open('wb') as stream:
        Writer(stream).start(profile='ros2')
        stream.write(content)


def empty_records(path: Path) -> None:
    records(path, (b'\x80' + bytes(8)) * 1_000_000)


def packed(record: Callable[[int], bytes], count: int) -> Callable[[Path], None]:
    """Return a maker of a bag whose chunks have so many records of one kind."""

    def write(path: Path) -> None:
        name = LOG_TYPES[STATE].encode()
        chunks = b''
        for first in range(0, count, 100_000):
            data = schema_record(1, name, SCHEMA.encode())
            data += b''.join(map(record, range(first, min(first + 100_000, count))))
            content = zstandard.compress(data)
            body = struct.pack('<QQQII', 0, 0, len(data), 0, 4) + b'zstd'
            body += struct.pack('<Q', len(content)) + content
            chunks += b'\x06' + struct.pack('<Q', len(body)) + body
        records(path, chunks)

    return write


def schema_record(number: int, name: bytes, data: bytes) -> bytes:
    body = struct.pack('<HI', number, len(name)) + name + struct.pack('<I', 7) + b'ros2msg'
    body += struct.pack('<I', len(data)) + data
    return b'\x03' + struct.pack('<Q', len(body)) + body


def channel_with_message(k: int) -> bytes:
    topic = f'/car{k}/z_vhcl'.encode()
    body = struct.pack('<HHI', k % 60_000, 1, len(topic)) + topic + struct.pack('<I', 3) + b'cdr'
    body += struct.pack('<I', 0)
    message = struct.pack('<HIQQ', k % 60_000, 0, 0, 0)
    return b''.join(
        kind + struct.pack('<Q', len(each)) + each
        for kind, each in ((b'\x04', body), (b'\x05', message))
    )


def long_definition(k: int) -> bytes:
    return schema_record(k % 60_000, b'a/msg/B', (f'int8 a{k}\n' * 20).encode())


def one_definition_of_many(path: Path) -> None:
    channels = b''.join(map(channel_with_message, range(2000)))
    records(path, schema_record(1, b'a/msg/B', b'int8 a\n' * 1_500_000) + channels)


def large_attachment(path: Path) -> None:
    bag(path, None, **{'student/controller.py': b'x = (1 +\n' * 4_200_000})


def long_code(path: Path) -> None:
    bag(path, None, **{f'student/{k}.py': b'a.' * 500_000 for k in range(8)})


def upright(path: Path) -> None:
    make(path, replace(LOG, theta_deg=LOG.theta_deg + 95.0))


CHAIN = {
    'nodes': [f'/n{k}' for k in range(1500)],
    'topics': {f'/t{k}': 'a/msg/B' for k in range(1500)},
    'publications': [[f'/n{k}', f'/t{k}'] for k in range(1500)],
    'subscriptions': [[f'/t{k}', f'/n{k + 1}'] for k in range(1499)],
}
#: By name: what makes the bag, and the sentence that one of the commands says, if it says any.
HOSTILE: dict[str, tuple[Callable[[Path], None], str]] = {
    'YAML aliases': (alias_bomb, ''),
    'a stamp far off': (one_stamp_far_off, 'between two of them, where a run has at most'),
    'zstd bomb': (zstd_bomb, 'has no states'),
    'many messages': (many_messages, 'unpacks to more than a recording of its size can hold'),
    'a long road': (with_metadata('road', '0:1,' * 75_000), "characters of metadata 'road'"),
    'JSON in JSON': (with_metadata('graph', '[' * 100_000), 'cannot be drawn'),
    'a chain of nodes': (with_metadata('graph', json.dumps(CHAIN)), 'cannot be drawn'),
    'an array of texts': (defined('float64 x ', 'string[400000000] big\nfloat64 x '), 'no states'),
    'seconds of text': (
        defined('int32 sec', 'string sec', b'\0\1\0\0\4\0\0\x00999\0' + bytes(64)),
        'no states',
    ),
    'a text for a number': (defined('float64 x ', 'string x '), 'no states'),
    'a type in itself': (
        defined('float64 x ', 'barc_interfaces/ZDynBkMdl[2] a\nfloat64 x '),
        'no states',
    ),
    'chunks that fail': (failing_chunks, 'unpacks to more than a recording of its size can hold'),
    'empty records': (empty_records, 'has no states of a car'),
    'many topics': (
        packed(channel_with_message, 1_000_000),
        'bytes of topics, metadata and',
    ),
    'many definitions': (packed(long_definition, 300_000), ''),
    'one long definition': (one_definition_of_many, 'has no states of a car'),
    'a large attachment': (large_attachment, 'is unfinished'),
    'long code': (long_code, ''),
    'an upright road': (upright, 'has a grade of'),
    'a compressed file': (
        lambda path: write_bomb(path, 'mcap'),
        'unpacks to more than a recording of its size can hold',
    ),
    'a compressed database': (
        lambda path: write_bomb(path, 'db3'),
        'unpacks to more than a recording of its size can hold',
    ),
    'pages without end': (
        write_endless_database,
        'unpacks to more than a recording of its size can hold',
    ),
}


#: One of each kind; the others are slow.
SAMPLE = ('a stamp far off', 'many messages', 'an array of texts')
CASES = [
    pytest.param(*case, id=name, marks=[pytest.mark.slow] * (name not in SAMPLE))
    for name, case in HOSTILE.items()
]
#: Runs a command, and prints its exit code, memory [B] and processor time [s]. It starts small:
#: Linux counts for a process also the memory that its parent had when it began.
_MEASURE = """
import resource, subprocess, sys
code = subprocess.run(sys.argv[1:]).returncode
used = resource.getrusage(resource.RUSAGE_CHILDREN)
print(code, used.ru_maxrss << 10, used.ru_utime + used.ru_stime)
"""


@pytest.mark.parametrize(('write', 'sentence'), CASES)
def test_a_hostile_bag_soon_gives_a_result_or_one_sentence(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    write: Callable[[Path], None],
    sentence: str,
) -> None:
    monkeypatch.delenv('DISPLAY', raising=False)
    path = tmp_path / 'bag'
    write(path)
    said = ''
    for command in COMMANDS:
        options = ['--save', 'graph.svg', '--bag'] if command == 'graph' else []
        words = [sys.executable, '-m', 'barc_sim', command, *options, str(path)]
        done = subprocess.run(
            [sys.executable, '-c', _MEASURE, *words],
            cwd=tmp_path,
            env=os.environ | ENVIRONMENT,
            capture_output=True,
            text=True,
            check=True,
        )
        code, memory, seconds = map(float, done.stdout.splitlines()[-1].split())
        assert code in {0, 1, 2}
        assert memory < MEMORY
        assert seconds < SECONDS
        assert 'Traceback' not in done.stderr
        if code == 2:
            assert done.stderr.splitlines()[-1].startswith(f'barc {command}: error: ')
        said += done.stdout + done.stderr
    assert sentence in said


def test_a_length_that_lies_reads_no_more_than_its_record(tmp_path: Path) -> None:
    file = tmp_path / 'run_0.mcap'
    with file.open('wb') as stream:
        Writer(stream).start(profile='ros2')
        body = struct.pack('<I', 8) + b'barc_sim' + struct.pack('<I', 2**32 - 1)
        body += struct.pack('<I', 2**31)
        stream.write(b'\x0c' + struct.pack('<Q', len(body)) + body)
        for _ in range(400):
            stream.write(b'\x80' + struct.pack('<Q', 10_000) + bytes(10_000))
    tracemalloc.start()

    assert reader.info(file) == {}

    assert tracemalloc.get_traced_memory()[1] < 1 << 20
    tracemalloc.stop()


def test_names_of_a_bag_do_not_control_the_terminal(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    cars = tmp_path / 'cars'
    cars.mkdir()
    writer = BagWriter(cars, metadata={'parameters': PARAMETERS})
    for namespace in ('/a', '/\x1b[2J'):
        fill(writer, LOG, namespace)
    writer.close()

    for arguments in (['plot', str(cars)], ['recover', str(cars)]):
        barc(arguments)

    captured = capsys.readouterr()
    assert '\x1b' not in captured.out + captured.err
    assert r'several cars, /a, /\x1b[2J' in captured.err
    assert r'/\x1b[2J/z_vhcl' in captured.out
