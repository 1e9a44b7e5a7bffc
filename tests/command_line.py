"""Runs commands of the package as a user does, in processes of their own."""

from __future__ import annotations

import os
import subprocess
import sys
import threading
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from rclpy.executors import SingleThreadedExecutor

import barc_sim

if TYPE_CHECKING:
    from collections.abc import Iterator

    from rclpy.context import Context
    from rclpy.node import Node

ENVIRONMENT = {'PYTHONPATH': str(Path(barc_sim.__file__).parents[1])}


def call(command: str, *options: str, timeout: float = 60.0) -> subprocess.CompletedProcess[str]:
    """Run `barc COMMAND` to its end."""
    return subprocess.run(
        [sys.executable, '-m', 'barc_sim', command, *options],
        env=os.environ | ENVIRONMENT,
        capture_output=True,
        text=True,
        check=False,
        timeout=timeout,
    )


@contextmanager
def started(command: str, *options: str) -> Iterator[subprocess.Popen[str]]:
    """Start it; it is gone afterwards."""
    with subprocess.Popen(
        [sys.executable, '-m', 'barc_sim', command, *options],
        env=os.environ | ENVIRONMENT,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    ) as process:
        try:
            yield process
        finally:
            process.kill()


@contextmanager
def spinning(context: Context, *nodes: Node) -> Iterator[None]:
    """Spin the nodes in a thread, and destroy them afterwards."""
    executor = SingleThreadedExecutor(context=context)
    for node in nodes:
        executor.add_node(node)
    thread = threading.Thread(target=executor.spin)
    thread.start()
    try:
        yield
    finally:
        executor.shutdown()
        thread.join()
        for node in nodes:
            node.destroy_node()
