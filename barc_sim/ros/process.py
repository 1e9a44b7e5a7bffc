"""Starts ROS in a process, with our settings of Fast DDS; spins a node, and ends in order."""

from __future__ import annotations

import fcntl
import os
import re
import stat
import sys
import time
from contextlib import contextmanager, suppress
from pathlib import Path
from tempfile import NamedTemporaryFile
from typing import TYPE_CHECKING, TypeVar

import rclpy
from rclpy.logging import LoggingSeverity, get_logger_level, set_logger_level
from rclpy.signals import SignalHandlerOptions
from rclpy.task import Future

from barc_sim.cli.files import open_regular
from barc_sim.cli.process import StopSignals, check_limits
from barc_sim.errors import UserError
from barc_sim.ros.executor import QuickExecutor
from barc_sim.ros.peers import FIRST_PORT, PORTS_PER_DOMAIN

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, MutableMapping

    from rclpy.node import Node

_Node = TypeVar('_Node', bound='Node')
#: Threads of the executor: the second one is for the time in which a callback blocks.
NUM_THREADS = 2
_MAX_DOMAIN = 232  #: the last domain whose UDP ports exist
#: rcutils' own format, on a cleared line: the status line of a run may stand there.
_CONSOLE_FORMAT = '\r\x1b[K[{severity}] [{time}] [{name}]: {message}'

_PROFILES = Path(__file__).with_name('fast_dds.xml')
PLAYER_PROFILES = Path(__file__).with_name('fast_dds_player.xml')
_VARIABLES = ('FASTRTPS_DEFAULT_PROFILES_FILE', 'FASTDDS_DEFAULT_PROFILES_FILE')
#: Without it, rmw overrides how histories use memory. ROS's QoS settings override the profiles in
#: both cases.
_USE_PROFILES = 'RMW_FASTRTPS_USE_QOS_FROM_XML'

#: An element of XML beside the profiles.
_SILENT_LOG = '<log><use_default>FALSE</use_default></log>'

_SHARED_MEMORY = Path('/dev/shm')  # noqa: S108 (where Fast DDS has it)
_LOCK = re.compile(r'fastrtps_[0-9a-f]{16}_el')
_PORT = re.compile(r'(?:sem\.)?fastrtps_port(\d+)(?:_el|_mutex)?')
_MIN_SHARED_MEMORY = 1 << 20  #: [B] for the segment of a participant, and its ports


@contextmanager
def ros(args: list[str] | None, *, network: bool = False) -> Iterator[None]:
    """Initialise ROS with `args`; by default, only this machine can discover the process.

    With `network`, the whole subnet can. The process may then open as many files as the system
    allows, and shared memory of dead processes is removed.
    """
    check_limits()
    if not any(os.environ.get(name) for name in ('HOME', 'ROS_HOME', 'ROS_LOG_DIR')):
        raise UserError('ROS has no folder for its logs: set HOME, or ROS_LOG_DIR to a folder')
    domain = os.environ.get('ROS_DOMAIN_ID', '')
    if domain.isdecimal() and int(domain[:9]) > _MAX_DOMAIN:
        raise UserError(f'ROS_DOMAIN_ID is {domain}: choose one from 0 to {_MAX_DOMAIN}')

    if network:
        os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'SUBNET'
    os.environ.setdefault('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    # No settings of Fast DDS from the working directory, which can be anyone's.
    os.environ.setdefault('SKIP_DEFAULT_XML_FILE', '1')
    use_profiles()

    check_ports(int(domain) if domain.isdecimal() else 0)
    sweep()
    if sys.stderr.isatty():
        os.environ.setdefault('RCUTILS_CONSOLE_OUTPUT_FORMAT', _CONSOLE_FORMAT)
    with _silent_without_shared_memory():
        _initialise(args)
        try:
            yield
        finally:
            rclpy.try_shutdown()


def _initialise(args: list[str] | None) -> None:
    """Initialise rclpy; UserError: it cannot start with these arguments and variables."""
    try:
        # rcl logs and raises its errors about arguments: show them once.
        set_logger_level('rcl', LoggingSeverity.FATAL)
        rclpy.init(args=args, signal_handler_options=SignalHandlerOptions.NO)
    except Exception as error:  # noqa: BLE001 (rclpy raises several private kinds)
        reason = re.sub(r',? at /\S+:\d+', '', str(error))  # without the line of rcl's source
        raise UserError(f'ROS cannot start with these arguments and variables: {reason}') from None
    if get_logger_level('rcl') == LoggingSeverity.FATAL:
        set_logger_level('rcl', LoggingSeverity.UNSET)


def new_executor() -> QuickExecutor:
    """Return the executor of the nodes of a process."""
    return QuickExecutor(num_threads=NUM_THREADS)


def spin(create: Callable[[], _Node], args: list[str] | None = None) -> _Node:
    """Spin the node that `create` returns until it is `finished` or a signal stops it.

    Return the node, which is destroyed.
    """
    with StopSignals() as stop, ros(args):
        node = create()
        executor = new_executor()
        executor.add_node(node)
        done = getattr(node, 'finished', None) or Future()
        stop.then(lambda: done.set_result(None))
        try:
            executor.spin_until_future_complete(done)
        finally:
            executor.shutdown()
            node.destroy_node()
    return node


def use_profiles(
    environment: MutableMapping[str, str] = os.environ, profiles: Path = _PROFILES
) -> None:
    """Set our profiles in `environment`, unless the user has set others there."""
    is_ours = environment.get(_VARIABLES[0]) == str(_PROFILES)  # set by this process's parent
    if is_ours or not any(name in environment for name in (*_VARIABLES, _USE_PROFILES)):
        environment[_VARIABLES[0]] = str(profiles)
        environment[_USE_PROFILES] = '1'


def has_shared_memory(folder: Path = _SHARED_MEMORY) -> bool:
    """Return whether Fast DDS can use shared memory; in a container, it often cannot."""
    try:
        free = os.statvfs(folder)
    except OSError:
        return False
    is_large = free.f_bavail * free.f_frsize >= _MIN_SHARED_MEMORY
    return is_large and os.access(folder, os.W_OK | os.X_OK)


@contextmanager
def _silent_without_shared_memory() -> Iterator[None]:
    """Let Fast DDS print nothing if it cannot use shared memory, unless the user has own profiles.

    Each process would print that, in red lines of C++. Messages go through UDP then.
    """
    profiles = os.environ.get(_VARIABLES[0])
    if profiles not in {str(_PROFILES), str(PLAYER_PROFILES)} or has_shared_memory():
        yield
        return
    text = Path(profiles).read_text(encoding='utf-8')
    with NamedTemporaryFile('w', prefix='fast_dds_', suffix='.xml', encoding='utf-8') as file:
        file.write(f'<dds>{_SILENT_LOG}{text[text.index("<profiles") :]}</dds>')
        file.flush()
        os.environ[_VARIABLES[0]] = file.name
        try:
            yield
        finally:
            os.environ[_VARIABLES[0]] = profiles


def check_ports(domain: int, folder: Path = _SHARED_MEMORY) -> None:
    """Raise UserError for a file of a ROS domain's ports that Fast DDS would wait for."""
    for file in folder.glob('*fastrtps_port*'):
        port = _PORT.fullmatch(file.name)
        if not port or (int(port[1]) - FIRST_PORT) // PORTS_PER_DOMAIN != domain:
            continue
        with suppress(OSError):  # it has been removed
            if not stat.S_ISREG(file.lstat().st_mode):
                raise UserError(
                    f'{str(file)!r} is not a regular file, and ROS would wait for it: remove it, '
                    'or choose another ROS_DOMAIN_ID'
                )


def sweep(folder: Path = _SHARED_MEMORY, min_age: float = 10.0) -> int:
    """Remove this user's shared-memory segments whose process is dead; return their number.

    Fast DDS gives each participant a segment `fastrtps_<16 hex digits>` of half a megabyte, and a
    file `..._el` that its process holds locked. A killed process leaves both, and no process uses
    them again. A hundred of them fill the small /dev/shm of a container. Fast DDS itself repairs
    the ports, which participants share.

    A lock younger than `min_age` [s] stays: its process may be about to take it.
    """
    removed = 0
    for lock in folder.glob('fastrtps_*_el'):
        with suppress(OSError, UserError):  # a process holds it, has removed it, or it is no lock
            status = lock.lstat()
            is_old = time.time() - status.st_ctime > min_age
            if _LOCK.fullmatch(lock.name) and is_old and status.st_uid == os.getuid():
                with open_regular(lock, follow=False) as file:
                    fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
                    lock.with_name(lock.name.removesuffix('_el')).unlink(missing_ok=True)
                    lock.unlink(missing_ok=True)
                    removed += 1
    return removed
