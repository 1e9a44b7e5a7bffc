"""Commands in a folder where a link, a pipe, a socket or a folder lies in place of a file.

A command runs once unharmed, while an audit hook of Python notes each file that it opens, makes,
renames or removes. Then it runs in a new copy of the folder, with something else at one of these
places. Nothing outside of the folder may change, and the command must end by itself.
"""

from __future__ import annotations

import os
import shutil
import socket
import stat
import subprocess
import sys
import tempfile
import time
from contextlib import contextmanager, nullcontext
from functools import cache
from pathlib import Path
from random import Random
from typing import TYPE_CHECKING

from _audit import note_files
from _command import CommandEnd, judge, run
from _places import BAG, KILLED, RUN, Place, copy_of_original, original, prepare_process
from _trial import ESCAPE, Trial

import barc_sim
from barc_sim.cli.process import has_ros

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

_ROOT = Path(barc_sim.__file__).parents[1]
#: The commands, and how often each is drawn: a slow one less.
_COMMANDS = {
    f'plot {BAG}': 4,
    f'plot {BAG} --save out/speed.svg': 4,
    'report': 4,
    f'report {BAG} -o out/report.html': 3,
    f'graph --bag {BAG} --save out/graph.svg': 3,
    f'replay {BAG} --save out/replay.gif': 1,
    f'recover {KILLED}': 6,
    'new new': 3,
    'check lab --rubric rubric.yaml': 2,
    'check lab --save out/check.png': 1,
    'submit lab --save out/lab.zip': 2,
    f'submit lab --course {BAG} --teleop {BAG} --video film.mp4': 2,
    'grade class --out grades --jobs 1 --rubric rubric.yaml': 3,
    'tune --distance 20 --save out/map.png': 1,
    'tune --distance 20 --controller lab/controller.py --road road.csv': 1,
    f'{RUN} --engine local --lab lab --road road.csv --bag-dir out/bags': 6,
    f'{RUN} --engine local --view web --view-port {{port}}': 4,
    f'{RUN} --engine local --no-bag --ros-args --params-file values.yaml': 2,
}
_OF_ROS = {
    f'{RUN} --engine ros --lab lab --road road.csv --bag-dir out/bags': 3,
    f'{RUN} --engine ros --no-bag --ros-args --params-file values.yaml': 2,
    'topics': 1,
    'graph --save out/live.svg': 2,
    'param list': 1,
}
#: Commands that last until Ctrl-C.
_LASTING = {
    'teleop --engine local --view none --lab lab --bag-dir out/bags': 3,
    f'replay {BAG} --view-port {{port}}': 1,
}
_LASTING_OF_ROS = {
    'teleop --engine ros --view web --view-port {port} --relay lab/relay.py': 3,
    'record -o out/recorded': 3,
    'node bag_recorder': 1,
    'echo rosout': 1,
}
_BESIDE_A_NODE = ('graph --save', 'param', 'echo', 'topics')
#: What a command of ROS uses without Python.
_FILES_OF_ROS = (
    *('home/.ros', 'home/.ros/log', 'home/.ros/log/latest'),
    *('DEFAULT_FASTDDS_PROFILES.xml', 'DEFAULT_FASTRTPS_PROFILES.xml'),
)
_DURATION = 5.0  #: [s] after which a command that lasts is asked to stop
#: What libraries keep in the user's own home, and words of a command that are no files.
_OF_LIBRARIES = ('home/.cache', 'home/.config', 'home/.fonts', 'home/.local/share', '-', 'fc-list')


def _link(target: str) -> Callable[[Path, Path], None]:
    def make(path: Path, outside: Path) -> None:
        path.symlink_to(outside / target)

    return make


def _folder(path: Path, _: Path) -> None:
    path.mkdir()
    (path / 'file').write_text('inside\n', encoding='utf-8')


def _pipe(path: Path, _: Path) -> None:
    os.mkfifo(path)


def _socket(path: Path, _: Path) -> None:
    folder = Path.cwd()
    os.chdir(path.parent)  # a socket's path is at most 108 characters
    with socket.socket(socket.AF_UNIX) as server:
        server.bind(path.name)
    os.chdir(folder)


def _hard_link(path: Path, outside: Path) -> None:
    path.hardlink_to(outside / 'file')


_KINDS: dict[str, Callable[[Path, Path], None]] = {
    'link to a file': _link('file'),
    'link to a folder': _link('folder'),
    'link to nothing': _link('nothing'),
    'link to a full disk': _link('/dev/full'),
    'link to endless zeros': _link('/dev/zero'),
    'hard link': _hard_link,
    'named pipe': _pipe,
    'socket': _socket,
    'folder': _folder,
}


def commands() -> dict[str, int]:
    """Return the commands that this machine has, and how often each is drawn."""
    of_ros = _OF_ROS | _LASTING_OF_ROS if has_ros() else {}
    return _COMMANDS | _LASTING | of_ros


def trials(seed: int, numbers: range) -> Iterator[Trial]:
    """Yield what became of each command."""
    weights = commands()
    for number in numbers:
        chance = Random(f'{seed} {number}')  # noqa: S311 (no secret)
        command = chance.choices([*weights], [*weights.values()])[0]
        name = chance.choice(_files(command))
        kind = chance.choice([*_KINDS])
        with tempfile.TemporaryDirectory() as folder:
            yield _try(number, command, name, kind, copy_of_original(Path(folder)))


def _try(number: int, command: str, name: str, kind: str, place: Place) -> Trial:
    """Run a command with something else in place of a file."""
    _replace_file(place.inside / name, kind, place.outside)
    before = _content(place.outside)
    start = time.monotonic()
    outcome, reason = judge(_run(command, place.inside))
    seconds = time.monotonic() - start
    after = _content(place.outside)

    harm = {path for path, content in before.items() if after.get(path) != content}
    # A folder that the user names, or has at home, may be a link.
    is_users_folder = name in (*command.split(), 'bags', 'out') or name.startswith('home/')
    if not is_users_folder:
        harm |= after.keys() - before.keys()
    if harm:
        outcome = ESCAPE
        reason = f'changed {sorted(harm)} outside'
    if reason:
        reason = f'barc {command}, {kind} at {name}: {reason}'
    return Trial(number, kind, outcome, seconds, 0.0, reason)


def _replace_file(path: Path, kind: str, outside: Path) -> None:
    """Put something else in place of a file, or where there is none yet."""
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path)
    path.unlink(missing_ok=True)
    path.parent.mkdir(parents=True, exist_ok=True)
    _KINDS[kind](path, outside)


def _run(command: str, folder: Path, notes: Path | None = None) -> CommandEnd:
    """Run a command, beside a node where it needs one; note the files that it uses in `notes`."""
    with socket.create_server(('127.0.0.1', 0)) as server:
        port = server.getsockname()[1]  # a free one
    words = command.format(port=port).split()
    duration = _DURATION if command in _LASTING | _LASTING_OF_ROS else None
    with _node() if command.startswith(_BESIDE_A_NODE) else nullcontext():
        return run(words, folder, lambda: _prepare(notes), duration)


@contextmanager
def _node() -> Iterator[None]:
    """Run a simulator, which waits for a controller, in a process of its own."""
    with tempfile.TemporaryDirectory() as folder:
        arguments = [sys.executable, '-m', 'barc_sim', 'node', 'vehicle_simulator']
        environment = os.environ | {'PYTHONPATH': str(_ROOT), 'HOME': folder}
        with subprocess.Popen(  # noqa: S603 (our own)
            arguments, cwd=folder, env=environment, stderr=subprocess.PIPE
        ) as process:
            assert process.stderr  # noqa: S101 (a pipe)
            process.stderr.readline()  # that it waits
            try:
                yield
            finally:
                process.kill()


def _content(folder: Path) -> dict[str, object]:
    """Return what lies in a folder: kinds, times and bytes."""
    content: dict[str, object] = {}
    for path in sorted(folder.rglob('*')):
        status = path.lstat()
        data = path.read_bytes() if stat.S_ISREG(status.st_mode) else b''
        time_of_change = 0 if path.is_dir() else status.st_mtime_ns
        content[str(path.relative_to(folder))] = (status.st_mode, time_of_change, data)
    return content


@cache
def _files(command: str) -> list[str]:
    """Return the files and folders that a command uses in its folder, by their paths in that.

    A file whose name differs from run to run, such as a temporary one, cannot be foreseen.
    """
    paths = (_noted_paths(command) & _noted_paths(command)) - {''}
    inside = original().inside
    paths |= {word for word in command.split() if (inside / word).exists()}

    # The processes that run a user's code note nothing: all in a folder that is used counts.
    for folder in sorted(paths):
        paths |= {str(path.relative_to(inside)) for path in (inside / folder).glob('**/*')}

    files = [path for path in paths if not path.startswith(_OF_LIBRARIES)]
    if command in _OF_ROS | _LASTING_OF_ROS:
        files += _FILES_OF_ROS
    return sorted(files)


def _noted_paths(command: str) -> set[str]:
    """Run a command unharmed; return the paths in its folder that it notes."""
    with tempfile.TemporaryDirectory() as folder:
        inside = copy_of_original(Path(folder)).inside
        notes = Path(folder) / 'notes'
        end = _run(command, inside, notes)
        if end.code not in (0, 1):  # of `check`: something is not right
            _, reason = judge(end)
            raise RuntimeError(f'barc {command}: {reason or end.text}')

        paths = notes.read_text(encoding='utf-8', errors='surrogateescape').split('\0')
        root = f'{inside}{os.sep}'
        inner = {os.path.normpath(path) for path in paths if path.startswith(root)}
        return {path.removeprefix(root) for path in inner}


def _prepare(notes: Path | None) -> None:
    """Prepare the process of a command, which notes the files that it uses in `notes`."""
    prepare_process()
    if notes:
        note_files(notes)
