"""A Dask cluster of processes on this machine, each in a network namespace where that is allowed.

A namespace has an address of its own, and reaches the others through a bridge only: for Dask its
process runs on another machine.
"""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
import time
from contextlib import contextmanager
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from pathlib import Path

_IP = shutil.which('ip')
_PORT = 8786
_DEADLINE = 60.0  # [s]


class Network:
    """Names and addresses of the machines of one cluster; without rights, all are this machine."""

    def __init__(self) -> None:
        self._name = f'barc{os.getpid() % 100_000}'
        self._subnet = f'10.{100 + os.getpid() % 100}.{os.getpid() // 100 % 250}'
        self._namespaces: list[str] = []
        self.is_virtual = False

    def open(self) -> None:
        """Make the bridge, if this process may."""
        if not _IP:
            return
        command = [_IP, 'link', 'add', self._name, 'type', 'bridge']
        if subprocess.run(command, capture_output=True, check=False).returncode:
            return
        self.is_virtual = True
        _ip('addr', 'add', f'{self._subnet}.254/24', 'dev', self._name)
        _ip('link', 'set', self._name, 'up')

    def machine(self, number: int) -> tuple[list[str], str]:
        """Return what begins a command of a machine, and its address; make its namespace."""
        if not self.is_virtual:
            return [], '127.0.0.1'
        name = f'{self._name}-{number}'
        address = f'{self._subnet}.{number}'
        inside = f'{self._name[4:]}i{number}'
        outside = f'{self._name[4:]}o{number}'
        if name not in self._namespaces:
            self._namespaces.append(name)
            _ip('netns', 'add', name)
            _ip('link', 'add', outside, 'type', 'veth', 'peer', 'name', inside, 'netns', name)
            _ip('link', 'set', outside, 'master', self._name, 'up')
            _ip('-n', name, 'addr', 'add', f'{address}/24', 'dev', inside)
            _ip('-n', name, 'link', 'set', inside, 'up')
            _ip('-n', name, 'link', 'set', 'lo', 'up')
        return [_IP or '', 'netns', 'exec', name], address

    def close(self) -> None:
        """Remove the namespaces and the bridge."""
        for name in self._namespaces:
            _ip('netns', 'del', name)
        if self.is_virtual:
            _ip('link', 'del', self._name)


def _ip(*words: str) -> None:
    assert _IP
    subprocess.run([_IP, *words], check=True)


class Cluster:
    """A scheduler, and workers that can be added and killed."""

    def __init__(self, network: Network, folder: Path) -> None:
        self._network = network
        self._folder = folder
        self._processes: list[subprocess.Popen[bytes]] = []
        self._machines = 1
        before, host = network.machine(1)
        port = _PORT if network.is_virtual else 0
        self._start(before, 'scheduler', '--host', host, '--port', f'{port}', '--no-dashboard')
        self.address = self._address(self._folder / '1.log')

    def _start(
        self, before: list[str], *words: str, path: Sequence[str] = ()
    ) -> subprocess.Popen[bytes]:
        with (self._folder / f'{len(self._processes) + 1}.log').open('wb') as log:
            process = subprocess.Popen(
                [*before, sys.executable, '-m', 'dask', *words],
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=subprocess.STDOUT,
                cwd=self._folder,
                env=os.environ | {'PYTHONPATH': os.pathsep.join([*path, *sys.path])},
                start_new_session=True,
            )
        self._processes.append(process)
        return process

    def _address(self, log: Path) -> str:
        """Return the address that the scheduler prints."""
        end = time.monotonic() + _DEADLINE
        while time.monotonic() < end:
            for word in log.read_text(encoding='utf-8').split():
                if word.startswith('tcp://'):
                    return word
            time.sleep(0.05)
        raise TimeoutError(log.read_text(encoding='utf-8'))

    def add_worker(self, *, threads: int = 1, path: Sequence[str] = ()) -> subprocess.Popen[bytes]:
        """Start a worker on a machine of its own, return its process.

        It imports what this process can, first from the folders of `path`.
        """
        self._machines += 1
        before, host = self._network.machine(self._machines)
        return self._start(
            before,
            *('worker', self.address, '--host', host, '--no-dashboard', '--no-nanny'),
            *('--nthreads', f'{threads}', '--local-directory', str(self._folder)),
            path=path,
        )

    def kill(self, worker: subprocess.Popen[bytes]) -> None:
        """Kill a worker with all that it has started, as the end of its machine would."""
        os.killpg(worker.pid, signal.SIGKILL)
        worker.wait()

    def close(self) -> None:
        """End all processes."""
        for process in self._processes:
            if process.poll() is None:
                self.kill(process)


@contextmanager
def dask_cluster(folder: Path, workers: int = 2, *, threads: int = 1) -> Iterator[Cluster]:
    """Start a scheduler and workers; end them, and remove their namespaces, after the block."""
    network = Network()
    cluster = None
    try:
        network.open()
        cluster = Cluster(network, folder)
        for _ in range(workers):
            cluster.add_worker(threads=threads)
        yield cluster
    finally:
        if cluster:
            cluster.close()
        network.close()
