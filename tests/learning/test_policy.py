"""A policy in a run: the trajectory of its environment, from a Python and from an ONNX file."""

from __future__ import annotations

import pickle
from base64 import b64decode
from typing import TYPE_CHECKING, Any

import pytest

pytest.importorskip('rclpy')

from command_line import call

from barc_sim.bags.reader import read
from barc_sim.errors import UserError
from barc_sim.learning.tasks import Policy
from barc_sim.simulation.closed_loop import lap, simulate

if TYPE_CHECKING:
    from pathlib import Path

    from barc_sim import Log

#: A product with the weights of a policy of `LANE`'s kind, in single precision.
ONNX = b64decode(
    'CAg6cQoRCgFvCgF3EgFhIgZNYXRNdWwSAXAqLwgJCAEQAUIBd0okzczMvpqZmb8AAAAAAAAAAGZmhkAAAAAAAAAAAAAA'
    'AAAAAAAAWhMKAW8SDgoMCAESCAoCCAEKAggJYhMKAWESDgoMCAESCAoCCAEKAggBQgQKABAN'
)
LANE = """
def policy(observation):
    e_y, e_psi, speed, latest, curvature, *ahead = observation
    return [4.2 * curvature - 0.4 * e_y - 1.2 * e_psi + 0.01 * latest]
"""
RACE = """
def policy(observation):
    e_y, e_psi, speed, motor, servo, curvature, *ahead = observation
    return [0.2 * (7.0 - speed) + 0.1 * motor, 4.2 * curvature - 0.4 * e_y - 1.2 * e_psi]
"""
HILLS = """
def policy(observation):
    error, speed, latest, grade, *ahead = observation
    return [0.5 * error + 1.2 * grade + 0.3 * ahead[0] + 0.01 * latest]
"""
TASKS = {'Lane': LANE, 'Race': RACE, 'Hills': HILLS}
LAB_CONTROLLER = """
class PID:
    def __init__(self, kp, ki, kd):
        pass

    def acc_calculate(self, speed_reference, speed_current):
        return 0.0
"""
LAB_LANE = """
class Lane:
    def steer_calculate(self, e_y, e_psi, speed, curvature):
        return 0.0
"""
FAST = ('--realtime-factor', 'max', '--view', 'none')


def function_of(source: str) -> Any:  # noqa: ANN401 (a function)
    names: dict[str, Any] = {}
    exec(source, names)  # noqa: S102 (of this file)
    return names['policy']


def assert_as_environment(log: Log, task: str, **options: Any) -> None:  # noqa: ANN401
    """Assert that a log is the trajectory of its policy in the environment, to the last bit."""
    gymnasium = pytest.importorskip('gymnasium', reason='needs the extra gym')
    env = gymnasium.make(f'barc_sim.learning:barc_sim/{task}-v0', **options)
    policy, columns = function_of(TASKS[task]), log.columns()
    places = columns['x' if task == 'Hills' else 's'].tolist()
    start = {'s': 0.0, 'v': 0.0} | ({} if task == 'Hills' else {'e_y': 0.0, 'e_psi': 0.0})
    observation, info = env.reset(options=start)
    assert len(places) > 500
    for s in places:
        assert info['s'] == s
        observation, _, _, _, info = env.step(policy(observation))


@pytest.mark.usefixtures('ros_domain')
@pytest.mark.parametrize(
    ('task', 'engine'), [*((task, 'local') for task in TASKS), ('Race', 'ros')]
)
def test_a_policy_drives_the_nodes_through_the_states_of_its_environment(
    tmp_path: Path, task: str, engine: str
) -> None:
    (tmp_path / 'policy.py').write_text(TASKS[task], 'utf-8')
    words = [] if task == 'Hills' else ['--track', 'oval', '--dynamics', 'dynamic']
    process = call('acc', '--policy', 'policy.py', '--engine', engine, *words, *FAST, cwd=tmp_path)
    assert process.returncode == 0, process.stderr
    log = read(next((tmp_path / 'bags').iterdir()))
    options = {} if task == 'Hills' else {'track': 'oval', 'dynamics': 'dynamic'}
    assert_as_environment(log, task, **options)


def test_a_policy_drives_in_python_through_the_states_of_its_environment() -> None:
    options: dict[str, Any] = {'track': 'oval', 'delay': 0.05}
    assert_as_environment(lap(Policy(function_of(LANE)), laps=1, **options), 'Lane', **options)
    hills = Policy(function_of(HILLS), 'Hills', speed=6.0)
    assert_as_environment(simulate(controller=hills, speed_reference=6.0), 'Hills', speed=6.0)


def test_an_onnx_file_steers_as_the_function_that_it_holds(tmp_path: Path) -> None:
    pytest.importorskip('onnxruntime', reason='needs the extra onnx')
    (tmp_path / 'policy.onnx').write_bytes(ONNX)
    source = LANE.replace('0.01 *', '0.0 *')
    logs = [
        lap(Policy(each), 'oval', laps=1)
        for each in (tmp_path / 'policy.onnx', function_of(source))
    ]
    assert logs[0].e_y == pytest.approx(logs[1].e_y, abs=1e-4)

    words = ('--track', 'oval', '--policy', 'policy.onnx', '--engine', 'local', *FAST)
    assert call('acc', *words, cwd=tmp_path).returncode == 0
    assert read(next((tmp_path / 'bags').iterdir())) == logs[0]

    law = Policy(tmp_path / 'policy.onnx')
    again = pickle.loads(pickle.dumps(law))  # noqa: S301 (our own)
    place = 0.3, 0.1, 5.0, lambda ahead: 0.01 * ahead
    assert again.steer_calculate(*place) == law.steer_calculate(*place)
    with pytest.raises(UserError, match=r"policy\.onnx'"):
        Policy(tmp_path / 'policy.onnx', 'Race')


@pytest.mark.parametrize(
    ('words', 'complaint'),
    [
        ('--policy none.py', "none.py' cannot be read"),
        ('--policy empty.py', 'empty.py defines no policy'),
        ('--policy none.onnx', "'none.onnx' cannot be read: there is no such file"),
        ('--policy bad.onnx', 'bad.onnx'),
        ('--policy lane.py', 'in Hills-v0, lane.py, line 3: policy(observation='),
        (
            '--track L --policy text.py',
            "in Lane-v0, action ['left']: each car takes a list of servo",
        ),
        ('--track L --policy lane.py --lane lqr', '--lane and --policy both drive: give one of'),
        ('--track L --policy text.py --lab lab', 'lane.py and --policy both drive'),
        ('--track L --policy race.py --ki 1', '--ki and --policy both drive'),
        ('--policy hills.py --reference speeds.csv', '--reference and --policy both drive'),
        ('--policy text.py --lab lab', 'controller.py and --policy both drive'),
        ('--policy lane.py --kp 1', '--kp and --policy both drive'),
        ('--policy lane.py --no-controller', '--policy and --no-controller: give one'),
    ],
)
def test_a_policy_that_cannot_drive_is_refused_in_a_sentence(
    tmp_path: Path, words: str, complaint: str
) -> None:
    (tmp_path / 'lane.py').write_text(LANE.replace('*ahead', 'a, b, c, d'), 'utf-8')
    (tmp_path / 'text.py').write_text('def policy(observation): return ["left"]', 'utf-8')
    (tmp_path / 'race.py').write_text(RACE, 'utf-8')
    (tmp_path / 'hills.py').write_text(HILLS, 'utf-8')
    (tmp_path / 'lab').mkdir()
    (tmp_path / 'lab' / 'controller.py').write_text(LAB_CONTROLLER, 'utf-8')
    (tmp_path / 'lab' / 'lane.py').write_text(LAB_LANE, 'utf-8')
    (tmp_path / 'empty.py').write_text('', 'utf-8')
    (tmp_path / 'bad.onnx').write_text('none', 'utf-8')
    process = call('acc', *words.split(), *FAST, cwd=tmp_path)

    assert process.returncode != 0
    assert complaint in process.stderr
    assert len(process.stderr.strip().splitlines()) == 1
    assert not (tmp_path / 'bags').exists()
