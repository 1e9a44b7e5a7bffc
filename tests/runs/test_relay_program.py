"""Drives by hand whose relay is a student's program of ROS, or another process."""

from __future__ import annotations

import os
import signal
from typing import TYPE_CHECKING

import pytest

pytest.importorskip('rclpy')

from command_line import barc, call, started
from relays import ROS_2, joystick

from barc_sim.bags import reader as bag
from barc_sim.bags.graph import NodeGraph

if TYPE_CHECKING:
    from pathlib import Path

pytestmark = pytest.mark.usefixtures('ros_domain')
DEADLINE = 100.0
UNSEEN = ('--view', 'none')
#: Dies at the first state of the car.
DIES = ROS_2.replace('import ECU', 'import ECU, ZDynBkMdl').replace(
    '    def on_twist',
    "        self.create_subscription(ZDynBkMdl, 'z_vhcl', self.on_state, 10)\n\n"
    '    def on_state(self, state):\n'
    '        raise ZeroDivisionError("a fault of mine")\n\n'
    '    def on_twist',
)


def newest(folder: Path) -> Path:
    (path,) = (folder / 'bags').iterdir()
    return path


@pytest.mark.slow
def test_a_program_of_rclpy_is_a_node_of_its_own_that_ends_with_the_run(tmp_path: Path) -> None:
    (tmp_path / 'mine.py').write_text(f'import os\nprint(os.getpid())\n{ROS_2}', encoding='utf-8')
    with started('teleop', *UNSEEN, '-q', '--relay', 'mine.py', cwd=tmp_path) as run:
        joystick()
        run.send_signal(signal.SIGTERM)
        out, err = run.communicate(timeout=DEADLINE)
    assert run.returncode == 0, err
    with pytest.raises(ProcessLookupError):
        os.kill(int(next(filter(str.isdigit, err.split()))), 0)

    path = newest(tmp_path)
    assert tmp_path / out.strip() == path
    assert 'Traceback' not in err
    assert bag.read(path).speed.max() >= 1.0
    assert list(bag.load(path).attachments) == ['student/mine.py']
    assert ('/relay', '/ecu') in NodeGraph.from_json(bag.info(path)['graph']).publications


@pytest.mark.parametrize(
    ('engine', 'sentence'),
    [
        ('ros', 'the relay mine.py has ended with exit code 1'),
        ('local', 'the relay raised ZeroDivisionError: a fault of mine'),
    ],
)
def test_a_program_that_fails_ends_the_run_with_a_sentence(
    tmp_path: Path, engine: str, sentence: str
) -> None:
    (tmp_path / 'mine.py').write_text(DIES, encoding='utf-8')
    process = call('teleop', '--engine', engine, *UNSEEN, '--relay', 'mine.py', cwd=tmp_path)
    assert process.returncode == 1
    assert process.stderr.splitlines()[-1].endswith(sentence)
    assert 'a fault of mine' in process.stderr
    assert bag.info(newest(tmp_path))['failure'].endswith(sentence)


def test_a_run_without_a_relay_waits_for_another(tmp_path: Path) -> None:
    with started('teleop', *UNSEEN, '--no-relay', cwd=tmp_path) as run:
        with started('node', 'relay', stdout=None, stderr=None):
            joystick()
        run.send_signal(signal.SIGTERM)
        out, err = run.communicate(timeout=DEADLINE)
    assert run.returncode == 0, err
    assert 'standard input is not a terminal: keys are ignored' in err
    assert 'held ↑' in out or 'missed deadlines' in out


@pytest.mark.parametrize(
    ('options', 'sentence'),
    [
        (('--no-relay', '--relay', 'mine.py'), '--relay and --no-relay: give one of the two'),
        (('--no-relay', '--engine', 'local'), '--no-relay needs ROS 2'),
        (('--realtime-factor', 'max'), 'nobody can drive at full speed (max)'),
    ],
)
def test_options_that_contradict_are_refused(
    tmp_path: Path, options: tuple[str, ...], sentence: str
) -> None:
    relay_file = tmp_path / 'mine.py'
    relay_file.write_text(ROS_2, encoding='utf-8')
    words = [str(relay_file) if word == 'mine.py' else word for word in options]
    process = barc('teleop', '--bag-dir', str(tmp_path / 'bags'), *words)
    assert process.returncode == 2
    assert sentence in process.stderr.splitlines()[-1].replace(str(relay_file), 'mine.py')
    assert not (tmp_path / 'bags').exists()
