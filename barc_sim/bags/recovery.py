"""Recovers a bag whose run was killed, or whose files are damaged."""

from __future__ import annotations

from secrets import token_hex
from typing import TYPE_CHECKING, Any

from barc_sim.bags.contents import Contents
from barc_sim.bags.file import BagFile, is_being_written
from barc_sim.bags.recording import Span, information, write_metadata
from barc_sim.bags.records import files
from barc_sim.cli.files import check_plain
from barc_sim.errors import UserError

if TYPE_CHECKING:
    from collections.abc import Iterable
    from pathlib import Path

    from barc_sim.bags.messages import Message
    from barc_sim.bags.records import McapFile


def recover(path: Path) -> tuple[Contents, list[Path]]:
    """Rewrite the damaged files of a bag, with their summaries, and its metadata.yaml.

    A damaged file is replaced once its successor is whole. If more than its last chunk was
    unreadable, the old one is kept as `<name>.damaged`. Return what could be read, and the files
    that were kept. UserError: there is no bag, it is still being recorded, nothing in it can be
    read, or the files cannot be written; the bag is unchanged.
    """
    directory = files(path)[0].parent
    check_plain(directory)
    contents = Contents(directory, run=True)
    spans: dict[str, Span] = {}  # by the files' names
    kept = []
    try:
        for file, messages in contents.by_file():
            kept += _recover_file(file, messages, contents, spans)
        write_metadata(directory, _information(contents, spans))
    except OSError as error:
        raise UserError(
            f'{str(directory)!r} cannot be recovered ({error.strerror}): copy it to a folder with '
            'space, and recover it there'
        ) from error
    return contents, kept


def _information(contents: Contents, spans: dict[str, Span]) -> dict[str, Any]:
    topics = contents.topics.items()
    counted = [(topic, count) for name, topic in topics if (count := contents.counts[name])]
    return information(spans, counted, contents.metadata)


def _recover_file(
    file: McapFile, messages: Iterable[Message], contents: Contents, spans: dict[str, Span]
) -> list[Path]:
    """Rewrite a file if it is damaged; return the old one where that is kept."""
    path = file.path
    if is_being_written(path):
        raise UserError(f'{str(path)!r} is being recorded: end the recording first')
    part = path.with_name(f'.{token_hex(8)}.part')
    copy, kept = BagFile(part), []
    try:
        copy.add_metadata(file.metadata)
        for each in file.attachments.values():
            copy.attach(each)
        for message in messages:
            copy.add([message])
            copy.commit()
        copy.end_chunk()
        spans[path.name] = copy.span
        contents.topics |= file.topics
        if file.damage:
            copy.finish(_information(contents, spans))
            copy.commit()
            if file.damage.unreadable_chunks or not file.damage.cut:
                kept.append(path.rename(_unused(path)))
            part.replace(path)
    finally:
        copy.appender.close()
        part.unlink(missing_ok=True)
    return kept


def _unused(file: Path) -> Path:
    path, number = file.with_name(f'{file.name}.damaged'), 2
    while path.exists():
        path, number = file.with_name(f'{file.name}.damaged{number}'), number + 1
    return path
