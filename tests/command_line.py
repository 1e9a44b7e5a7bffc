"""Runs commands of the package as a user does, in processes of their own."""

from __future__ import annotations

import io
import os
import subprocess
import sys
import threading
import time
from contextlib import contextmanager, redirect_stderr, redirect_stdout
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
from rosbags.highlevel import AnyReader

import barc_sim
from barc_sim.__main__ import main

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from rclpy.context import Context
    from rclpy.node import Node

ENVIRONMENT = {'PYTHONPATH': str(Path(barc_sim.__file__).parents[1])}


def call(*words: str, timeout: float = 200.0, **options: Any) -> subprocess.CompletedProcess[str]:  # noqa: ANN401
    """Run `barc COMMAND`, with `options` of Popen, to its end."""
    with started(*words, **options) as process:
        out, err = process.communicate(timeout=timeout)
    return subprocess.CompletedProcess(words, process.returncode, out, err)


def barc(*words: str, main: Callable[..., int] = main) -> subprocess.CompletedProcess[str]:
    """Run `barc COMMAND`, or another `main`, in this process.

    What stands in for ROS needs a process of its own.
    """
    if 'local' in words:
        return call(*words)
    with redirect_stdout(io.StringIO()) as out, redirect_stderr(io.StringIO()) as err:
        try:
            code: Any = main([*words])
        except SystemExit as end:  # of argparse
            code = end.code
    return subprocess.CompletedProcess(words, code, out.getvalue(), err.getvalue())


def printed(*words: str, code: int = 0) -> str:
    """Run `barc COMMAND` in this process, which ends with `code`; return what it prints."""
    result = barc(*words)
    assert result.returncode == code, result.stderr
    return result.stdout


def refused(*words: str) -> str:
    """Run `barc COMMAND` in this process, which refuses in one line; return that line."""
    result = barc(*words)
    assert (result.returncode, result.stdout) == (2, '')
    (line,) = result.stderr.splitlines()
    assert line.startswith(f'barc {words[0]}: error: ')
    return line


def wait_for(condition: Callable[[], object], seconds: float = 100.0) -> None:
    """Wait for what another thread or process does, without ROS."""
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.005)


def acc(folder: Path, *options: str) -> subprocess.CompletedProcess[str]:
    """Run `acc` quietly in `folder`; return how it ended."""
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        return barc('acc', '-q', *options)


def bag_of(folder: Path, *options: str) -> Path:
    """Run `acc` in `folder` and return its bag."""
    process = acc(folder, *options)
    assert process.returncode == 0, process.stderr
    return folder / process.stdout.strip()


def messages(path: Path) -> dict[str, list[Any]]:
    """Return the messages of a bag by topic, in the order of their reception."""
    by_topic: dict[str, list[Any]] = {}
    with AnyReader([path]) as reader:
        for connection, _, data in reader.messages():
            message = reader.deserialize(data, connection.msgtype)
            by_topic.setdefault(connection.topic, []).append(message)
    return by_topic


@contextmanager
def started(*words: str, **options: Any) -> Iterator[subprocess.Popen[str]]:  # noqa: ANN401
    """Start `barc COMMAND` with `options` of Popen; it is gone afterwards."""
    usual = {
        'env': os.environ | ENVIRONMENT,
        'stdin': subprocess.DEVNULL,
        'stdout': subprocess.PIPE,
        'stderr': subprocess.PIPE,
    }
    command = [sys.executable, '-m', 'barc_sim', *words]
    with subprocess.Popen(command, text=True, **usual | options) as process:
        try:
            yield process
        finally:
            process.kill()


@contextmanager
def spinning(context: Context, *nodes: Node) -> Iterator[None]:
    """Spin the nodes in a thread, and destroy them afterwards; commands wait until they find them.

    A command that finds no other process of this machine gives up sooner: here, nodes are its own.
    """
    from barc_sim.ros.executor import QuickExecutor  # noqa: PLC0415 (most tests need no ROS)

    executor = QuickExecutor(context=context)  # rclpy's may fail where another thread ends it
    for node in nodes:
        executor.add_node(node)
    thread = threading.Thread(target=executor.spin)
    thread.start()
    try:
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr('barc_sim.ros.introspection.others_here', lambda _: True)
            patch.setattr('barc_sim.ros.introspection._FIRST_TIMEOUT', 60.0)  # a busy machine
            yield
    finally:
        executor.shutdown()
        thread.join()
        for node in nodes:
            node.destroy_node()
