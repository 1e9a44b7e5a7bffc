"""Names the command that converts a bag of sqlite3, or of compressed files, to MCAP.

Bags up to ROS 2 Humble have no definitions of their types. rosbags then takes those of a typestore:
`foxy` and `humble` of this module, by the reference on the command line.
"""

from __future__ import annotations

import shlex
import sqlite3
from contextlib import closing, suppress
from functools import cache
from typing import TYPE_CHECKING, Any
from urllib.parse import quote

from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from barc_sim.cli.files import open_regular
from barc_sim.cli.parser import program_path
from barc_sim.cli.yaml_files import from_yaml
from barc_sim.errors import UserError
from barc_sim.interfaces.definitions import definition, installed

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence
    from pathlib import Path

    from rosbags.typesys.store import Typestore

_DISTRIBUTIONS = {'foxy': Stores.ROS2_FOXY, 'humble': Stores.ROS2_HUMBLE}
_FIRST_WITH_DEFINITIONS = 6  # version of metadata.yaml: that of Iron
_VERSION_OF_HUMBLE = 5
_MAX_METADATA = 1 << 20  # bytes of metadata.yaml
_MAX_STEPS = 1_000_000  # of sqlite, for a query


@cache
def _typestore(distribution: str) -> Typestore:
    """Return the types of a distribution, and all other types that are installed here."""
    store = get_typestore(_DISTRIBUTIONS[distribution])
    for name in installed():
        if '/msg/' not in name or name in store.fielddefs:
            continue
        with suppress(Exception):  # a file that rosbags cannot parse
            types = get_types_from_msg(definition(name), name)
            new_names = types.keys() - store.fielddefs.keys()
            store.register({new_name: types[new_name] for new_name in new_names})
    return store


def __getattr__(name: str) -> Typestore:
    """Return a typestore by the name of its distribution."""
    if name in _DISTRIBUTIONS:
        return _typestore(name)
    raise AttributeError(name)


def conversion(path: Path, present: Iterable[Path]) -> str:
    """Return the sentence that names the command to convert a bag.

    Parameters
    ----------
    path
        The bag.
    present
        The files of the bag.
    """
    # rosbags-convert reads a folder with metadata.yaml, or uncompressed files one by one.
    has_metadata = path.is_dir() and (path / 'metadata.yaml').exists()
    databases = [] if has_metadata else sorted(file for file in present if file.suffix == '.db3')
    folder = path if path.is_dir() else path.parent
    sources = databases or [folder]
    program = program_path('rosbags-convert') or 'rosbags-convert'
    words = ['--src', *map(str, sources), '--dst', 'NEW', '--dst-storage', 'mcap']

    unknown: list[str] = []
    with suppress(ValueError, OSError, UserError, sqlite3.Error, LookupError, TypeError):
        if databases:
            distribution, types = _types_of_databases(databases)
        else:
            distribution, types = _types_of_metadata(folder)
        if distribution:
            words += ['--src-typestore-ref', f'{__name__}:{distribution}']
            unknown = sorted(set(types) - _typestore(distribution).fielddefs.keys())
    if unknown:
        words += ['--exclude-msgtype', *unknown]

    sentence = (
        f'{str(path)!r} is a bag of sqlite3, or of compressed files: convert it to MCAP with '
        f'`{program} {shlex.join(words)}`'
    )
    if unknown:
        sentence += (
            f'; this leaves out the messages of {", ".join(unknown)}, as the definition is neither '
            'in the bag nor installed here'
        )
    return sentence


def _types_of_metadata(folder: Path) -> tuple[str | None, list[str]]:
    """Return distribution and types of a bag with metadata.yaml; None: it has definitions."""
    with open_regular(folder / 'metadata.yaml', follow=False) as stream:
        text = stream.read(_MAX_METADATA).decode()
    information: Any = from_yaml(text)['rosbag2_bagfile_information']
    topics = information['topics_with_message_count']
    types = [str(topic['topic_metadata']['type']) for topic in topics]
    version = int(information['version'])
    if version >= _FIRST_WITH_DEFINITIONS:
        return None, types
    return 'humble' if version == _VERSION_OF_HUMBLE else 'foxy', types


def _types_of_databases(files: Sequence[Path]) -> tuple[str | None, list[str]]:
    """Return distribution and types of a bag without metadata.yaml; None: it has definitions."""
    tables: set[str] = set()
    types: list[str] = []
    for file in files:
        open_regular(file).close()
        uri = f'file:{quote(str(file.absolute()))}?mode=ro&immutable=1'
        with closing(sqlite3.connect(uri, uri=True)) as database:
            database.set_progress_handler(lambda: 1, _MAX_STEPS)  # a view can be endless
            tables |= {name for (name,) in database.execute('SELECT name FROM sqlite_master')}
            types += [str(name) for (name,) in database.execute('SELECT type FROM topics')]
    if 'message_definitions' in tables:
        return None, types
    return 'humble' if 'schema' in tables else 'foxy', types
