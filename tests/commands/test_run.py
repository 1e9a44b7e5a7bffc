"""`barc acc` and `python -m barc_sim.run`: options, output, and how a run ends."""

from __future__ import annotations

import os
import random
import re
import signal
import subprocess
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

pytest.importorskip('rclpy')

from command_line import bag_of, barc, printed
from mcap.reader import make_reader
from rosbags.highlevel import AnyReader

from barc_sim.bags import reader as bag
from barc_sim.cli.parser import INTERRUPTED
from barc_sim.run import main

if TYPE_CHECKING:
    from collections.abc import Callable

    Start = Callable[..., subprocess.Popen[str]]

PRELUDE = 'import signal, sys\n'
SCRIPT = 'from barc_sim.run import main; sys.exit(main())'
MAX = ('--realtime-factor', 'max')
SHORT = (*MAX, '--distance', '1')
ENDLESS = ('--distance', '0')
pytestmark = pytest.mark.usefixtures('ros_domain')


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return an empty folder to run in."""
    folder = tmp_path / 'here'
    folder.mkdir()
    monkeypatch.chdir(folder)
    return folder


@pytest.fixture
def start(start: Start, here: Path) -> Start:
    """Return a function that starts a run, which is gone after the test."""

    def run(*options: str, prelude: str = PRELUDE) -> subprocess.Popen[str]:
        environment = os.environ | {'TERM': 'xterm', 'COLUMNS': '120'}
        return start('-c', prelude + SCRIPT, *options, cwd=here, env=environment)

    return run


def driving(process: subprocess.Popen[str]) -> None:
    """Wait until a run that is not quiet drives."""
    assert process.stdout
    assert process.stdout.readline().startswith('engine ')
    assert ' m/s ' in process.stdout.readline()


def assert_whole(path: Path) -> None:
    """Check that a bag is closed and complete."""
    with AnyReader([path]) as reader:
        assert sum(1 for _ in reader.messages()) == reader.message_count
    assert 'steps' in bag.info(path)


@pytest.mark.parametrize(
    ('command', 'words'),
    [
        ('fly', "'fly'"),
        ('acc --realtime-factor 0', "nor 'max'"),
        ('acc --no-bag --bag-dir x', 'not allowed with'),
        ('acc --road nowhere', "road 'nowhere' is neither 'lab', 'flat' nor"),
        ('acc --road {broken}', 'describes no road'),
        ('acc --bag-dir {file}', 'is not a folder'),
        ('acc --bag-dir /proc/bags', "no bag can be made in '/proc/bags'"),
        ('acc --controller-type mpc', "invalid choice: 'mpc'"),
        ('acc --gain kp', "'kp' is not a gain: expected NAME=VALUE"),
        ('acc --gain kp=', "'' is not a number"),
        ('acc --gain kp=1 --kp 2', '--gain kp and --kp give the same'),
        ('acc --reference a.csv --speed 3', '--speed and --reference both give the speed'),
        ('acc --gain mass=3', 'mass: this controller has no such gain, but kp, ki, kd'),
        ('acc --controller-type lqr --gain observer_gain=2', '2 is not a number from 0 to 1'),
        (
            'acc --controller-type lqr --kp 3',
            'kp: this controller has no such gain, but speed_weight',
        ),
        (
            'acc --no-controller --controller-type lqr',
            '--controller-type and --no-controller: give',
        ),
        ('acc --laps 3 --distance 0', 'laps 3 with distance 0, at which no lap ends'),
        ('acc --ros-args -p controller_type:=mpc', "'mpc': expected pid or lqr"),
        ('acc --ros-args -r z_vhcl', "'-r z_vhcl'"),
        ('acc --cars 2 --ros-args -r __ns:=/a', 'the namespace /a would hold for every car'),
        ('acc --ros-args -p vehicle_simulator:mass:=-1.0', 'mass of vehicle_simulator: -1 is not'),
    ],
)
def test_bad_input_is_refused_in_one_line_and_leaves_no_file(
    here: Path, tmp_path: Path, command: str, words: str
) -> None:
    files = {'file': tmp_path / 'file', 'broken': tmp_path / 'broken.csv'}
    for file in files.values():
        file.write_text('start_m,grade_deg\n0,steep\n')
    process = barc(*command.format(**files).split(), main=main)

    assert (process.returncode, process.stdout) == (2, '')
    assert ' error: ' in process.stderr
    assert words in process.stderr
    assert process.stderr.count('\n') == 1
    assert not list(here.iterdir())


# Options and output


def test_parameters_after_ros_args_count_unless_an_option_is_given(here: Path) -> None:
    parameters = (
        '--ros-args',
        '-p',
        'vehicle_simulator:distance:=1.0',
        '-p',
        'controller:kp:=20.0',
    )

    path = bag_of(here, *MAX, '--kp', '25', '--bag-dir', 'a/b', *parameters)
    assert_whole(path)
    assert path.parent == here / 'a' / 'b'

    log = bag.read(path)
    assert log.x[-2] < 1.0 <= log.x[-1]
    assert bag.info(path)['kp'] == '25.0'


@pytest.mark.parametrize(
    'options',
    [
        ('--engine', 'ros', '--max-bag-duration', '2'),
        # Without ROS, messages wait in memory anyway: a small cache loses none.
        ('--engine', 'local', '--max-bag-duration', '2', '--max-cache-size', '1000'),
        ('--engine', 'local', '--max-bag-size', '50000'),
    ],
)
def test_a_split_bag_of_a_run_has_the_states_of_one_file(
    here: Path, options: tuple[str, ...]
) -> None:
    drive = (*MAX, '--distance', '60')
    split = bag_of(here, *drive, *options, '--compression-format', 'lz4')
    assert len([*split.glob('*.mcap')]) > 1
    assert bag.info(split)['lost_messages'] == '0'
    whole = bag.read(bag_of(here, *drive))
    assert bag.read(split).x.tolist() == whole.x.tolist()


@pytest.mark.parametrize('engine', ['ros', 'local'])
def test_a_parameter_that_no_node_has_is_named(here: Path, engine: str) -> None:
    sections = {
        'vehicle_simulator': 'mass',  # it is in a namespace
        'car1/controller': 'kpp',
        '/car1/vehicle_simulator': 'mass',
        'planner': 'rate',  # of another system
        '/**': 'use_sim_times',
    }
    text = (f'{node}:\n  ros__parameters:\n    {name}: 3e3\n' for node, name in sections.items())
    (here / 'all.yaml').write_text(''.join(text))
    words = ('--params-file', 'all.yaml', '-p', 'ki:=2.0', '-p', 'kj:=2.0', '-p', 'pid:kp:=2.0')
    run = ('acc', *MAX, '--no-bag', '--distance', '0.3', '--engine', engine)
    process = barc(*run, '--ros-args', '-r', '__ns:=/car1', *words)

    assert re.findall('warning: (.*) sets nothing', process.stderr) == [
        'all.yaml vehicle_simulator:mass',
        'all.yaml car1/controller:kpp',
        '-p kj',
        '-p pid:kp',
    ]
    assert process.returncode == 0


def test_the_real_time_factor_scales_the_time_of_the_run(here: Path) -> None:
    path = bag_of(here, '--distance', '0.3', '--realtime-factor', '0.5')
    (file,) = path.glob('*.mcap')
    with file.open('rb') as stream:
        states = make_reader(stream).iter_messages(['/z_vhcl'])
        times = [message.publish_time for _, _, message in states]
    # 40 ms for a step of 20 ms; a machine that stalls makes it longer, none makes it shorter.
    assert (times[-1] - times[0]) / (len(times) - 1) > 35e6


@pytest.mark.usefixtures('here')
def test_a_pipe_gets_plain_lines_a_table_and_the_next_commands() -> None:
    out = printed('acc', *SHORT)
    assert '\x1b' not in out

    lines = out.splitlines()
    assert lines[0] == 'engine     ROS 2 (rclpy)'
    assert lines[1].endswith('0.000 m/s  error +8.000 m/s  grade +0°')
    assert 'whole run' in out

    bag_line, plot_line, replay_line = lines[-3:]
    path = bag_line.removeprefix('bag').strip()
    assert_whole(Path(path))
    # Quoted where the path of the environment has a space.
    assert plot_line.replace("'", '').endswith(f'bin/barc plot {path}')
    assert replay_line.replace("'", '').endswith(f'bin/barc replay {path}')


# How it ends


def test_a_closed_pipe_ends_the_run_in_order(start: Start, here: Path) -> None:
    process = start('acc', *ENDLESS)
    driving(process)
    assert process.stdout
    process.stdout.close()  # as `| head -1` does
    assert process.wait(timeout=200) == 0

    assert process.stderr
    assert 'Traceback' not in process.stderr.read()

    (path,) = (here / 'bags').iterdir()
    assert_whole(path)


@pytest.mark.parametrize(
    'number', [signal.SIGINT, pytest.param(signal.SIGHUP, marks=pytest.mark.slow)]
)
def test_signal_ends_the_run_in_order_also_where_it_comes_twice(
    start: Start, here: Path, number: signal.Signals
) -> None:
    process = start('acc', *ENDLESS)
    driving(process)
    process.send_signal(number)
    process.send_signal(signal.SIGTERM)  # `timeout` signals the process, and then its group
    out, err = process.communicate(timeout=200)
    assert (process.returncode, 'Traceback' in err) == (0, False)
    assert 'whole run' in out

    (path,) = (here / 'bags').iterdir()
    assert_whole(path)


@pytest.mark.parametrize(
    'seed', [*range(2), *(pytest.param(seed, marks=pytest.mark.slow) for seed in range(2, 12))]
)
def test_signal_at_any_moment_leaves_a_whole_bag_or_none(
    start: Start, here: Path, seed: int
) -> None:
    chance = random.Random(seed)  # noqa: S311 (no secret)
    number = chance.choice([signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
    # A signal before this ends Python's own start, with its traceback.
    announce_start = (
        'signal.signal(signal.SIGINT, signal.SIG_DFL); print(file=sys.stderr, flush=True)\n'
    )
    process = start('acc', '-q', *SHORT, prelude=PRELUDE + announce_start)
    assert process.stderr
    process.stderr.readline()
    try:
        # Imports, nodes, run, close and the interpreter's end take about 0.7 s.
        process.wait(chance.uniform(0.0, 0.85))
    except subprocess.TimeoutExpired:
        process.send_signal(number)
    out, err = process.communicate(timeout=200)
    assert 'Traceback' not in err
    assert 'Exception ignored' not in err

    bags = list((here / 'bags').iterdir()) if (here / 'bags').exists() else []
    if process.returncode in {-number, INTERRUPTED}:  # it came before the run could take over
        assert not bags
    else:
        assert process.returncode == 0
        assert [here / line for line in out.splitlines()] == bags
        for path in bags:
            assert_whole(path)
