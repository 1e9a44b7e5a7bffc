"""A recorder under a flood: its task is JSON on the command line, and so are its figures."""

from __future__ import annotations

import json
import resource
import signal
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path
from typing import Any

import yaml
from _timed import TimedRun

from barc_sim.cli.process import StopSignals
from barc_sim.ros.process import ros


class _FloodedRun:
    """A run that meets a flood, and ends after it."""

    def __init__(self, task: dict[str, Any], folder: Path) -> None:
        options = ['--distance', '0']
        if task['recorder'] == 'no recorder':
            options += ['--no-bag']
        else:
            options += ['--bag-dir', str(folder)]

        self._task = task
        self._folder = folder
        self._timed_run = TimedRun(*options)
        self._published = 0
        self._load: dict[str, float] = {}

    def drive(self, stop: StopSignals) -> None:
        """Drive through the flood."""
        threading.Thread(target=self._flood).start()
        self._timed_run.spin(stop)

    def figures(self) -> dict[str, float]:
        """Return what was published, lost and used."""
        timing = self._timed_run.timing()
        bag = self._timed_run.run.bag
        return {
            'sent': self._published,
            'lost': self._published - (_recorded_count(self._folder) if bag else 0),
            'lost, as counted': bag.recorder.missing.total if bag else 0,
            **self._load,
            'step jitter p99, ms': timing['jitter p99, ms'],
            'missed': timing['missed'],
        }

    def _flood(self) -> None:
        time.sleep(1.0)  # the run's start is not what is measured
        self._timed_run.log.ticks.clear()
        start = time.perf_counter()
        process_start = time.process_time()
        thread_start = _recorder_time()
        self._published = _flood(self._task)

        hundredth = (time.perf_counter() - start) / 100.0
        self._load['core, %'] = (time.process_time() - process_start) / hundredth
        self._load['recorder threads, %'] = (_recorder_time() - thread_start) / hundredth
        self._timed_run.run.finish()


def _recorder_time() -> float:
    """Return the processor time of the recorder's threads [s]; 0 if there are none."""
    return sum(
        time.clock_gettime(time.pthread_getcpuclockid(thread.ident))
        for thread in threading.enumerate()
        if thread.name == 'recorder' and thread.ident
    )


def _flood(task: dict[str, Any]) -> int:
    """Publish in a process of its own; return how many messages were published."""
    if not task['topics']:
        time.sleep(task['seconds'])
        return 0

    program = str(Path(__file__).with_name('_flood.py'))
    process = subprocess.run(  # noqa: S603 (our own)
        [sys.executable, program, json.dumps(task)], stdout=subprocess.PIPE, check=True
    )
    return int(process.stdout)


def _recorded_count(folder: Path) -> int:
    """Return how many messages of the flood are in a bag."""
    (metadata,) = folder.rglob('metadata.yaml')
    information = yaml.safe_load(metadata.read_text())['rosbag2_bagfile_information']
    return sum(
        topic['message_count']
        for topic in information['topics_with_message_count']
        if topic['topic_metadata']['name'].startswith('/flood')
    )


def _run(task: dict[str, Any], folder: Path) -> dict[str, float]:
    with ros([]), StopSignals() as stop:
        run = _FloodedRun(task, folder)
        run.drive(stop)
    return run.figures()


def _rosbag2(task: dict[str, Any], folder: Path) -> dict[str, float]:
    command = ['ros2', 'bag', 'record', '--all-topics', '--storage', 'mcap']
    if task['depth']:
        profile = {'history': 'keep_last', 'depth': task['depth'], 'reliability': 'reliable'}
        overrides = {f'/flood_{number}': profile for number in range(task['topics'])}
        (folder / 'qos.yaml').write_text(json.dumps(overrides))  # JSON is YAML
        command += ['--qos-profile-overrides-path', str(folder / 'qos.yaml')]
    recorder = subprocess.Popen(  # noqa: S603 (the user's)
        [*command, '--output', str(folder / 'bag')],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )

    start = time.perf_counter()
    published = _flood(task)
    seconds = time.perf_counter() - start
    recorder.send_signal(signal.SIGINT)
    recorder.wait()

    usage = resource.getrusage(resource.RUSAGE_CHILDREN)  # of the flood, too
    core = (usage.ru_utime + usage.ru_stime) / seconds * 100.0
    return {
        'sent': published,
        'lost': published - _recorded_count(folder),
        'core, % (with the flood)': core,
    }


def main() -> None:
    """Do the task on the command line."""
    task = json.loads(sys.argv[1])
    measure = _rosbag2 if task['recorder'].startswith('rosbag2') else _run
    with tempfile.TemporaryDirectory() as folder:
        print(json.dumps(measure(task, Path(folder))))


if __name__ == '__main__':
    main()
