"""Converts many bags to tables, in this process or on the workers of an executor."""

from __future__ import annotations

import logging
import shutil
import threading
from contextlib import contextmanager
from secrets import token_hex
from typing import TYPE_CHECKING, NamedTuple

from barc_sim.bags.convert import convert
from barc_sim.bags.run_table import write_run_tables
from barc_sim.errors import UserError
from barc_sim.parallel.pieces import finished_pieces

if TYPE_CHECKING:
    import re
    from collections.abc import Iterable, Iterator
    from concurrent.futures import Executor
    from pathlib import Path


class Conversion(NamedTuple):
    """A bag to convert, and the folder to make for its tables."""

    bag: Path
    output: Path
    topics: tuple[re.Pattern[str], ...] = ()  #: see `recording_settings.selected`
    exclude: tuple[re.Pattern[str], ...] = ()
    is_elsewhere: bool = False  #: whether another machine may convert it


class Converted(NamedTuple):
    """How a conversion went."""

    failure: str  #: a sentence; empty if there are tables
    warnings: tuple[str, ...]


def convert_bag(conversion: Conversion) -> None:
    """Write the topics of a bag to tables, and its runs unless topics are chosen.

    Raises
    ------
    UserError
        As `convert` does.
    """
    convert(conversion.bag, conversion.output, conversion.topics, conversion.exclude)
    if not (conversion.topics or conversion.exclude):
        write_run_tables(conversion.bag, conversion.output)


def convert_bags(
    conversions: Iterable[Conversion], executor: Executor | None
) -> Iterator[tuple[Conversion, Converted]]:
    """Convert bags; yield each with how it went, as it is ready. One that fails stops no other.

    Parameters
    ----------
    conversions
        The bags, with absolute paths if an executor converts them.
    executor
        Converts several at a time. By default this process converts one after the other.
    """
    if executor is None:
        for conversion in conversions:
            yield conversion, _converted(conversion)
        return

    for conversion, future in finished_pieces(executor, _converted, conversions):
        try:
            converted = future.result()
        except Exception as error:  # noqa: BLE001 (the worker's end has many types)
            converted = Converted(f'its worker has failed: {error}', ())
        yield conversion, converted


def _converted(conversion: Conversion) -> Converted:
    """Convert a bag; workers call this."""
    failure = ''
    with _warnings() as warnings:
        try:
            _check_reachable(conversion)
            with _new_folder(conversion.output) as folder:
                convert_bag(conversion._replace(output=folder))
        except UserError as error:
            failure = str(error)
        except OSError as error:
            failure = f'{str(conversion.output)!r} cannot be written ({error.strerror})'
    return Converted(failure, tuple(warnings))


def _check_reachable(conversion: Conversion) -> None:
    """Raise UserError if another machine lacks the bag, or the folder of its output."""
    for path in (conversion.bag, conversion.output.parent):
        if conversion.is_elsewhere and not path.exists():
            raise UserError(
                f'a worker of the cluster finds no {str(path)!r}: name bags, and an --output, in '
                'a folder that all its machines share'
            )


@contextmanager
def _new_folder(output: Path) -> Iterator[Path]:
    """Give the path of a folder to make, which becomes `output` when the block succeeds.

    So a worker that ends leaves nothing in the way of the one that converts its bag again.
    """
    if output.exists() or output.is_symlink():
        raise UserError(f'{str(output)!r} exists: name a new --output')
    part = output.with_name(f'.{token_hex(8)}')
    try:
        yield part
        part.rename(output)
    finally:
        shutil.rmtree(part, ignore_errors=True)


@contextmanager
def _warnings() -> Iterator[list[str]]:
    """Collect the warnings of barc_sim in this thread, in place of printing them."""
    handler = _ThreadWarnings()
    logger = logging.getLogger('barc_sim')
    logger.addHandler(handler)
    try:
        yield handler.texts
    finally:
        logger.removeHandler(handler)


class _ThreadWarnings(logging.Handler):
    """Keeps the texts of warnings of the thread that made it."""

    def __init__(self) -> None:
        super().__init__(logging.WARNING)
        self._thread = threading.get_ident()
        self.texts: list[str] = []

    def emit(self, record: logging.LogRecord) -> None:
        """Keep a warning; `logging` calls this."""
        if record.thread == self._thread:
            self.texts.append(record.getMessage())
