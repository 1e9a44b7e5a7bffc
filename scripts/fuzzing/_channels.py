"""Bags whose channels have schemas and encodings of all kinds, written by mcap's own writer."""

from __future__ import annotations

import io
from typing import TYPE_CHECKING, Any

from mcap.reader import SeekingReader
from mcap.writer import CompressionType, Writer

if TYPE_CHECKING:
    from pathlib import Path
    from random import Random

_WHOLE = 'a whole file of channels'  # as the library in the header
_MESSAGES = ('cdr', 'cdr', 'json', 'protobuf', 'ros1', 'cbor', 'flatbuffer', '', 'x' * 300)
_SCHEMAS = ('ros2msg', 'ros2idl', 'jsonschema', 'protobuf', 'ros1msg', 'omgidl', '', 'é' * 300)
_TOPICS = ('/a', '/a', '/z_vhcl', '/ecu', 'no slash', '', '/é', '/\x1b[2J')
_NAMES = (
    *('std_msgs/msg/Float64', 'std_msgs/Float64', 'a/srv/B_Event', 'a/action/B_FeedbackMessage'),
    *('barc_interfaces/msg/ZDynBkMdl', 'Pose', '', 'a.b.C', '/', 'a/b/c/d'),
)
_TEXTS = (
    b'',
    b'float64 data\n',
    b'# no field\n',
    b'=' * 80 + b'\nIDL: a/msg/B\nmodule a { module msg { struct B { double x; }; }; };\n',
    b'=' * 80 + b'\nIDL: a/msg/B\nmodule a {',
    b'{"type": "object"}',
    bytes(range(256)),
    b'\xff' * 40,
)
_DATA = (b'', b'\0\1\0\0' + bytes(8), b'{"x": 1}', b'\x28\xb5\x2f\xfd', b'\0\3\0\0' + bytes(300))
_METADATA: tuple[dict[str, str], ...] = (
    {},
    {'offered_qos_profiles': '- {durability: 1, depth: 1}', 'topic_type_hash': 'RIHS01_0'},
    {'offered_qos_profiles': '[[[', 'é': '\0'},
)


def channels(chance: Random, *, whole: bool) -> bytes:
    """Return a file with a few channels and messages; `whole` marks it for `check_same`."""
    stream = io.BytesIO()
    writer = Writer(stream, compression=CompressionType.ZSTD)
    writer.start('ros2', _WHOLE if whole else '')

    schemas = [0]  # none
    for _ in range(chance.randint(0, 5)):
        name = chance.choice(_NAMES)
        encoding = chance.choice(_SCHEMAS)
        schemas.append(writer.register_schema(name, encoding, chance.choice(_TEXTS)))

    for number in range(chance.randint(1, 8)):
        metadata = dict(chance.choice(_METADATA), number=str(number))
        topic = chance.choice(_TOPICS)
        encoding = chance.choice(_MESSAGES)
        channel = writer.register_channel(topic, encoding, chance.choice(schemas), metadata)

        for sequence in range(chance.randint(1, 20)):
            received = chance.choice((0, 10**18, 10**18 + sequence, 2**63))
            writer.add_message(channel, received, chance.choice(_DATA), sequence, sequence)

    writer.finish()  # type: ignore[no-untyped-call]
    return stream.getvalue()


def check_same(before: Path, after: Path) -> None:
    """Raise an AssertionError if a whole file's channels and messages are not those of `after`."""
    is_whole = _WHOLE.encode() in before.read_bytes()[:200]
    if is_whole and _messages(before) != _messages(after):
        raise AssertionError(f'{_messages(before)} has become {_messages(after)}')


def _messages(path: Path) -> list[Any]:
    """Return the messages of a file with their channels, in an order that no reader changes."""
    messages = []
    with path.open('rb') as stream:
        for schema, channel, message in SeekingReader(stream).iter_messages():
            messages.append(
                (
                    channel.topic,
                    channel.message_encoding,
                    sorted(channel.metadata.items()),
                    schema and (schema.name, schema.encoding, schema.data),
                    (message.sequence, message.log_time, message.publish_time, message.data),
                )
            )
    return sorted(messages, key=repr)
