"""The page of an ended run: downloads, the run before, and another run."""

from __future__ import annotations

import io
import json
import os
import zipfile
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from urllib.request import urlopen

import pytest
from command_line import ENVIRONMENT, printed, started
from page_client import connect_page, wait

from barc_sim import read_bag
from barc_sim.__main__ import parse
from barc_sim.bags import reader
from barc_sim.runs.ended_run import EndedRun, next_command

PATIENCE = 30.0  #: [s]
VALUES = {'kp': 4.0, 'ki': 8.0, 'kd': 0.0, 'speed_reference': 6.0, 'acceleration_limit': 5.0}
URL = 'http://127.0.0.1:4711/a-token/'


def drive(folder: Path, *options: str) -> Path:
    words = ('--realtime-factor', 'max', '--bag-dir', str(folder))
    return Path(printed('acc', *words, *options, '--quiet').strip())


def test_next_command_line_has_the_values_of_the_sliders() -> None:
    argv = ['acc', '--kp', '30', '--laps', '2', '--ros-args', '-p', 'rate:=100.0']
    words = next_command(argv, VALUES | {'noise_v_x': 0.1}, 4711)
    options = parse(words[0], words[1:])
    assert dict(options.gain) == {'kp': 4.0, 'ki': 8.0, 'kd': 0.0}
    assert (options.speed, options.acceleration_limit, options.laps) == (6.0, 5.0, 2)
    assert (options.view, options.view_port) == ('web', 4711)
    given = ['-p', 'vehicle_simulator:noise_v_x:=0.1']
    assert options.ros_args == ['--ros-args', '-p', 'rate:=100.0', *given]
    assert next_command(['teleop'], {}, 80) == ['teleop', '--view', 'web', '--view-port', '80']
    again = next_command(words, VALUES, 4711)
    assert dict(parse('acc', again[1:]).gain) == dict(options.gain)


@pytest.mark.usefixtures('ros_domain')
def test_report_and_bag_can_be_downloaded_and_the_run_before_is_compared(tmp_path: Path) -> None:
    # The names of bags have seconds.
    before = drive(tmp_path, '--distance', '12', '--kp', '4').rename(
        tmp_path / '2026-01-01_00-00-00'
    )
    bag = drive(tmp_path, '--distance', '12')
    page: Any = SimpleNamespace(url=URL)
    ended = EndedRun(page, ['acc'], bag)
    offered = json.loads(ended.offer())
    assert offered['files'] == ['report.html', 'bag.zip']
    assert offered['before'] == before.name
    report = ended.file('report.html')
    assert report
    assert report.name == f'{bag.name}.html'
    assert b'Speed error' in report.body
    archive = ended.file('bag.zip')
    assert archive
    with zipfile.ZipFile(io.BytesIO(archive.body)) as files:
        files.extractall(tmp_path / 'copy')
    assert read_bag(tmp_path / 'copy' / bag.name).speed.tobytes() == read_bag(bag).speed.tobytes()
    assert ended.file('secret') is None
    other, rows = ended.compare()
    assert json.loads(other)['title'] == before.name
    assert len(rows) % 8 == 0
    assert EndedRun(page, ['acc'], None).file('bag.zip') is None


@pytest.mark.slow
@pytest.mark.usefixtures('ros_domain')
def test_page_ends_the_run_and_drives_again_with_other_gains(tmp_path: Path) -> None:
    words = ('acc', '--view', 'web', '--laps', '0')
    with started(*words, cwd=tmp_path, env=os.environ | ENVIRONMENT, stderr=None) as process:
        assert process.stdout
        process.stdout.readline()
        url = process.stdout.readline().split()[-1]
        with connect_page(url) as socket:
            known = wait(socket, 'hello')
            while 'kp' not in known['tuning']:
                known = wait(socket, 'facts')
            wait(socket, 'status')
            socket.send(json.dumps({'type': 'finish'}))
            assert wait(socket, 'end')['bag']
            assert wait(socket, 'kept')['files']
            with urlopen(f'{url}bag.zip', timeout=PATIENCE) as answer:  # noqa: S310 (our own)
                assert zipfile.ZipFile(io.BytesIO(answer.read())).namelist()
            socket.send(json.dumps({'type': 'tune', 'name': 'kp', 'value': 4.5}))
            assert wait(socket, 'facts')['tuning']['kp'] == 4.5
            socket.send(json.dumps({'type': 'again'}))
            address = wait(socket, 'again')['address']
        while not (line := process.stdout.readline()).startswith('live page'):
            assert line
        assert line.split()[-1] == address
        with connect_page(address) as socket:
            known = wait(socket, 'hello')
            while known['tuning'].get('kp') != 4.5:
                known = wait(socket, 'facts')
            socket.send(json.dumps({'type': 'finish'}))
            assert wait(socket, 'kept')['before']
        assert process.wait(PATIENCE) == 0  # the page is closed
    newest = max((tmp_path / 'bags').iterdir())
    assert '--gain kp=4.5' in reader.info(newest)['command']
