"""Floods a recorder: takes a task as JSON on the command line, prints the figures as JSON."""

from __future__ import annotations

import json
import resource
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


def main() -> None:
    """Do the task on the command line."""
    task = json.loads(sys.argv[1])
    with tempfile.TemporaryDirectory() as folder:
        work = _rosbag2 if task['recorder'].startswith('rosbag2') else _run
        print(json.dumps(work(task, Path(folder))))


def _flood(task: dict[str, Any]) -> int:
    """Publish in a process of its own; return how many messages were published."""
    if not task['topics']:
        time.sleep(task['seconds'])
        return 0
    program = str(Path(__file__).with_name('_flood.py'))
    done = subprocess.run(  # noqa: S603 (our own)
        [sys.executable, program, json.dumps(task)], stdout=subprocess.PIPE, check=True
    )
    return int(done.stdout)


def _kept(folder: Path) -> int:
    """Return how many messages of the flood are in a bag."""
    (metadata,) = folder.rglob('metadata.yaml')
    information = yaml.safe_load(metadata.read_text())['rosbag2_bagfile_information']
    return sum(
        topic['message_count']
        for topic in information['topics_with_message_count']
        if topic['topic_metadata']['name'].startswith('/flood')
    )


def _run(task: dict[str, Any], folder: Path) -> dict[str, float]:
    sent: list[int] = []
    used: dict[str, float] = {}

    def publish() -> None:
        time.sleep(1.0)  # the run's start is not what is measured
        threads = (t.ident for t in threading.enumerate() if t.name == 'recorder' and t.ident)
        clock = next(map(time.pthread_getcpuclockid, threads), None)
        began = time.perf_counter()
        processor = time.process_time()
        own = time.clock_gettime(clock) if clock else 0.0
        run.clock.ticks.clear()
        sent.append(_flood(task))
        taken = (time.perf_counter() - began) / 100.0
        used['core, %'] = (time.process_time() - processor) / taken
        used['recorder thread, %'] = (time.clock_gettime(clock) - own if clock else 0.0) / taken
        run.run.finish()

    with ros([]), StopSignals() as stop:
        option = ['--no-bag'] if task['recorder'] == 'no recorder' else ['--bag-dir', str(folder)]
        run = TimedRun('--distance', '0', *option)
        threading.Thread(target=publish).start()
        run.spin(stop)
        timing = run.timing()
    bag = run.run.bag
    counted = bag.recorder.missing.total if bag else 0
    return {
        'sent': sent[0],
        'lost': sent[0] - (_kept(folder) if bag else 0),
        'lost, as counted': counted,
        **used,
        'step jitter p99, ms': timing['jitter p99, ms'],
        'missed': timing['missed'],
    }


def _rosbag2(task: dict[str, Any], folder: Path) -> dict[str, float]:
    command = ['ros2', 'bag', 'record', '--all-topics', '--storage', 'mcap']
    if task['depth']:
        profile = {'history': 'keep_last', 'depth': task['depth'], 'reliability': 'reliable'}
        overrides = {f'/flood_{n}': profile for n in range(task['topics'])}
        (folder / 'qos.yaml').write_text(json.dumps(overrides))  # JSON is YAML
        command += ['--qos-profile-overrides-path', str(folder / 'qos.yaml')]
    recorder = subprocess.Popen(  # noqa: S603 (the user's)
        [*command, '--output', str(folder / 'bag')],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    began = time.perf_counter()
    sent = _flood(task)
    taken = time.perf_counter() - began
    recorder.send_signal(2)
    recorder.wait()
    used = resource.getrusage(resource.RUSAGE_CHILDREN)  # with what the flood has used
    core = (used.ru_utime + used.ru_stime) / taken * 100.0
    return {'sent': sent, 'lost': sent - _kept(folder), 'core, % (with the flood)': core}


if __name__ == '__main__':
    main()
