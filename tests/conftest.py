"""Fixtures of the tests with ROS in them: each in a domain of its own, none waits for ever."""

from __future__ import annotations

import gc
import os
import random
import signal
import socket
import subprocess
import sys
import time
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
from hypothesis import settings
from rosbag2_types import provide_rosbag2_interfaces

import barc_sim
from barc_sim.cli.process import has_ros

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from browser import Browser
    from rclpy.context import Context
    from rclpy.executors import Executor

# Without ROS its tests are left out.
collect_ignore = [] if has_ros() else ['ros', 'commands/test_introspection.py']

if has_ros():
    from barc_sim.ros.process import use_profiles

    # Fast DDS reads its profiles once in a process, before the first node: all have a run's.
    use_profiles()

# In an activated environment, commands print shorter lines.
_programs = str(Path(sys.executable).parent)
_folders = os.environ['PATH'].split(os.pathsep)
os.environ['PATH'] = os.pathsep.join(each for each in _folders if each != _programs)
# On a desktop, no test opens a browser.
os.environ['BARC_SIM_NO_BROWSER'] = '1'

#: [characters]
_LONGEST_ID = 60

# How long an example takes is the machine's affair.
settings.register_profile('any machine', deadline=None)
settings.load_profile('any machine')


def pytest_make_parametrize_id(val: object, argname: str) -> str | None:
    """Return the id of a parameter: a truth with its name, and the values of a container."""
    if isinstance(val, bool):
        return f'{argname}={val}'
    if isinstance(val, (dict, list, tuple)) and _has_text(val):
        return str(val)[:_LONGEST_ID]
    return None


def _has_text(value: object) -> bool:
    """Return whether a value's text is the same in every process, as no object's address is."""
    if isinstance(value, dict):
        return all(_has_text(each) for each in value.values())
    if isinstance(value, (list, tuple)):
        return all(_has_text(each) for each in value)
    return isinstance(value, (bool, bytes, float, int, str, type(None)))


def _take_signals() -> None:
    """Let signals do what they do in a program that a terminal starts, and in all that it starts.

    A process that was started in the background ignores Ctrl-C, by nohup a hang-up. A command that
    ran in this process ignores all three from its end on.
    """
    signal.signal(signal.SIGINT, signal.default_int_handler)
    for name in ('SIGTERM', 'SIGHUP'):  # the last one not on Windows
        if hasattr(signal, name):
            signal.signal(getattr(signal, name), signal.SIG_DFL)


_take_signals()


@contextmanager
def _own_environment() -> Iterator[None]:
    """Undo at the end what tests, and commands in this process, do to the environment."""
    before = dict(os.environ)
    try:
        yield
    finally:
        os.environ.clear()
        os.environ.update(before)


@pytest.fixture(autouse=True)
def _undone() -> Iterator[None]:
    """Undo what a command does in this process; before, too, as a module's fixture runs some."""
    _take_signals()
    interval = sys.getswitchinterval()
    with _own_environment():
        yield
    sys.setswitchinterval(interval)
    gc.unfreeze()
    if 'rclpy' in sys.modules:
        from rclpy.logging import LoggingSeverity, set_logger_level  # noqa: PLC0415

        set_logger_level('', LoggingSeverity.INFO)
    _take_signals()


@contextmanager
def _reserved_domain() -> Iterator[int]:
    """Reserve a ROS domain that no other process of this machine uses.

    A bound port is the reservation, as in ament's domain_coordinator; so is that of the domain's
    first participant, which may not have reserved it. From 102 on, Linux gives the ports to others.
    """
    for domain in random.sample(range(1, 102), 101):
        with socket.socket() as reservation, socket.socket(type=socket.SOCK_DGRAM) as participant:
            try:
                reservation.bind(('localhost', 22119 + domain))
                participant.bind(('', 7400 + 250 * domain + 10))
            except OSError:
                continue
            participant.close()
            yield domain
            return
    raise RuntimeError('all ROS domains of this machine are in use')


@contextmanager
def _own_domain(log_dir: Path) -> Iterator[int]:
    """Reserve a ROS domain for this process, and for those that it starts."""
    with _reserved_domain() as domain, _own_environment():
        os.environ |= {
            'ROS_DOMAIN_ID': str(domain),
            'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST',
            'ROS_LOG_DIR': str(log_dir),
            'PYTHONPATH': str(Path(barc_sim.__file__).parents[1]),
        }
        yield domain


@pytest.fixture(scope='session')
def rosbag2_interfaces(request: pytest.FixtureRequest) -> dict[str, str]:
    """Make rosbag2_interfaces importable; return the environment of a process that needs it."""
    return provide_rosbag2_interfaces(request.config.cache.mkdir('rosbag2_interfaces'))


@pytest.fixture
def ros_domain(tmp_path: Path) -> Iterator[int]:
    """Return a ROS domain that is this test's own, also for processes that it starts."""
    with _own_domain(tmp_path / 'ros_log') as domain:
        yield domain


@pytest.fixture(scope='module')
def module_domain(tmp_path_factory: pytest.TempPathFactory) -> Iterator[int]:
    """Return a ROS domain for the runs that the tests of a module share."""
    with _own_domain(tmp_path_factory.mktemp('ros_log')) as domain:
        yield domain


@pytest.fixture
def ros(ros_domain: int) -> Iterator[Context]:
    """Return an initialised context in a domain of its own, to give to each node and executor."""
    from rclpy.context import Context  # noqa: PLC0415 (tests without ROS start faster without)

    context = Context()
    context.init(domain_id=ros_domain)
    yield context
    context.try_shutdown()


@pytest.fixture(scope='session')
def browser() -> Iterator[Browser]:
    """Return the one browser of all tests, with a profile of its own."""
    from browser import Browser  # noqa: PLC0415 (most tests need none)

    with Browser() as browser:
        yield browser


@pytest.fixture
def start(tmp_path: Path) -> Iterator[Callable[..., subprocess.Popen[str]]]:
    """Return a function that starts Python in `tmp_path`; the process is gone after the test."""
    started: list[subprocess.Popen[str]] = []

    def start(
        *arguments: str | Path,
        before: tuple[str, ...] = (),
        **options: Any,  # noqa: ANN401 (of Popen)
    ) -> subprocess.Popen[str]:
        pipes = dict.fromkeys(('stdout', 'stderr'), subprocess.PIPE)
        process = subprocess.Popen(
            [*before, sys.executable, *arguments],
            text=True,
            **{'cwd': tmp_path, 'stdin': subprocess.DEVNULL} | pipes | options,
        )
        started.append(process)
        return process

    yield start
    for process in started:
        process.kill()
        process.communicate()


@pytest.fixture
def spin_until() -> Callable[[Executor, Callable[[], bool]], None]:
    """Return a function that spins an executor until a condition holds, or fails."""

    def spin(executor: Executor, condition: Callable[[], bool], *, deadline: float = 100.0) -> None:
        end = time.monotonic() + deadline
        while not condition():
            if time.monotonic() > end:
                pytest.fail(f'the condition did not come true within {deadline} s')
            executor.spin_once(timeout_sec=0.05)

    return spin
