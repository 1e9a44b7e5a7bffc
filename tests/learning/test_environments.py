"""The environments: Gymnasium's own checks, one car as a batch, and what a run would do."""

from __future__ import annotations

import pickle
from itertools import product
from math import sin
from typing import Any

import numpy as np
import pytest
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure

from barc_sim.control.lane import LaneLQR
from barc_sim.errors import UserError
from barc_sim.figures import windows
from barc_sim.figures.colours import VERMILLION
from barc_sim.learning.preview import AHEAD, row_at
from barc_sim.learning.tasks import TASKS, DrivingTask
from barc_sim.simulation.closed_loop import lap, simulate
from barc_sim.simulation.scenario import Scenario
from barc_sim.vehicle.bicycles import LateralParameters
from barc_sim.vehicle.bike_model import Vehicle
from barc_sim.vehicle.plant import Actuator, NoiseLevels, Sensor
from barc_sim.vehicle.road import Profile, Road
from barc_sim.vehicle.track import Track

gymnasium = pytest.importorskip('gymnasium', reason='needs the extra gym')

from gymnasium.utils.env_checker import check_env  # noqa: E402

from barc_sim.learning import batch, environments  # noqa: E402

COURSE = slice(220, 360)  #: the rows of a picture that have the course and the chart
IDS = {name: f'barc_sim/{name}-v0' for name in ('Hills', 'Lane', 'Race')}
NOISE = NoiseLevels(s=0.02, ey=0.02, epsi=0.01, v_x=0.05)
RANGES = {'mass': (1000.0, 3000.0), 'delay': (0.0, 0.1), 'noise': (0.0, 0.1), 'l_r': (1.0, 2.0)}


def wind(t: float, s: float) -> float:
    """Return a force [N] that changes over time and place."""
    return 500.0 * sin(t) + s


OPTIONS: dict[str, dict[str, Any]] = {
    'plain': {},
    'noise': {'noise': NOISE},
    'delay': {'delay': 0.05, 'speed': 7.0},
    'ranges': {'ranges': RANGES, 'vehicle': Vehicle(air_drag_coeff=1.0)},
    'dynamic': {'dynamics': 'dynamic', 'noise': 0.1, 'ts': 0.01},
    'late': {'sensor_delay': 0.05, 'noise': NOISE, 'ranges': {'disturbance': (-900.0, 900.0)}},
    'actuators': {'integrator': 'rk4', 'motor': Actuator(delay=0.03, lag=0.1), 'disturbance': wind},
    'tyres': {'dynamics': 'dynamic', 'ranges': {'front_stiffness': (8e4, 1.5e5)}, 'delay': 0.033},
}
ELSEWHERE: dict[str, dict[str, Any]] = {
    'Hills': {'road': 'flat', 'acceleration_limit': 3.0},
    'Lane': {'track': 'figure-eight', 'servo': Actuator(rate=2.0, limit=0.3)},
    'Race': {
        'track': 'oval',
        'road': Road((0.0, 30.0), (5.0, -3.0)),
        'servo': Actuator(lag=0.2),
        'ranges': {'delay': (0.0, 0.1)},
    },
}
OPEN = Track((30.0, 20.0), (0.0, 0.05))
GUST = Profile('time_s', (0.0, 0.2, 0.2), (0.0, 2000.0, 0.0))
SCENARIO = Scenario(
    track='oval',
    road=Road((0.0, 30.0), (5.0, -3.0)),
    vehicle=Vehicle(mass=1500.0),
    servo=Actuator(lag=0.2),
    noise=NOISE,
    disturbance=GUST,
    speed_reference=7.0,
    max_duration=5.0,
)
INFO = ('s', 'e_y', 'lap', 'lap_time')
CASES = [(name, options) for name in IDS for options in (*OPTIONS.values(), ELSEWHERE[name])]


@pytest.mark.parametrize(('name', 'options'), CASES)
def test_gymnasium_accepts_each_environment_with_each_option(
    name: str, options: dict[str, Any]
) -> None:
    check_env(gymnasium.make(IDS[name], **options).unwrapped, skip_render_check=True)


@pytest.fixture
def shown_figures(monkeypatch: pytest.MonkeyPatch) -> list[Figure]:
    """Return the windows that open, each without a display; none is shown at once."""
    opened: list[Figure] = []

    def window(_: str) -> Figure:
        opened.append(Figure())
        return opened[-1]

    monkeypatch.setattr(windows, 'window', window)
    for name in ('show', 'close'):
        monkeypatch.setattr(windows, name, lambda *_, **__: None)
    return opened


@pytest.mark.parametrize(('name', 'mode'), [*product(IDS, (None, 'rgb_array')), ('Lane', 'human')])
def test_gymnasium_accepts_each_render_mode(
    name: str, mode: str, shown_figures: list[Figure]
) -> None:
    env = gymnasium.make(IDS[name], render_mode=mode, ts=0.01)
    check_env(env.unwrapped)
    assert env.metadata['render_fps'] == 100
    assert len(shown_figures) == 1 + (mode == 'human')


def place_of(frame: Any) -> Any:  # noqa: ANN401 (an array)
    """Return column and row of the dot that is the car on its whole course."""
    assert (frame.shape, frame.dtype) == ((360, 640, 3), np.uint8)
    colour = np.multiply(to_rgb(VERMILLION), 255.0)
    is_dot = (abs(frame[COURSE] - colour) < 30.0).all(axis=2)
    return np.argwhere(is_dot).mean(axis=0)[::-1]


@pytest.mark.parametrize('name', IDS)
def test_a_picture_shows_where_the_car_is_and_changes_nothing(name: str) -> None:
    modes = 'rgb_array', None
    env, blind = (gymnasium.make(IDS[name], render_mode=mode, noise=0.1) for mode in modes)
    for seed in (1, 2):
        places = []
        for car in (env, blind):
            car.reset(seed=seed, options={'s': 2.0, 'v': 5.0})
        for _ in range(3):
            places.append(place_of(env.render()))
            for _ in range(20):
                action = np.zeros(env.action_space.shape)
                np.testing.assert_equal(env.step(action), blind.step(action))
        assert (np.diff(places, axis=0)[:, 0] > 1.0).all()  # each course begins to the right

    assert blind.render() is None


def test_a_window_shows_each_step_until_it_is_closed(shown_figures: list[Figure]) -> None:
    env = gymnasium.make(IDS['Race'], render_mode='human')
    env.reset(seed=1)
    (window,) = shown_figures
    pictures: list[Any] = [window.images[0].get_array()]
    env.step([0.0, 0.0])
    pictures.append(window.images[0].get_array())
    assert not np.array_equal(*pictures)

    window.canvas.callbacks.process('close_event', None)
    env.step([0.0, 0.0])
    assert window.images[0].get_array() is pictures[1]

    env.close()


def test_without_a_display_a_warning_says_so_and_the_environment_runs(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(windows, 'window', lambda *_: None)
    env = gymnasium.make(IDS['Hills'], render_mode='human')
    with pytest.warns(UserWarning, match='there is no display, so no window opens'):
        env.reset()
    env.step([0.0])


def actions_of(shape: tuple[int, ...], steps: int) -> Any:  # noqa: ANN401 (arrays)
    """Yield smooth random actions, some beyond their bounds."""
    random = np.random.default_rng(0)
    action = np.zeros(shape)
    for _ in range(steps):
        action = 0.9 * action + 0.2 * random.standard_normal(shape)
        yield action.astype(np.float32)


def rows(result: Any) -> list[Any]:  # noqa: ANN401 (of reset or step)
    """Return the numbers of all cars, each as an array."""
    *values, info = result
    times = np.array([len(laps) + sum(laps) for laps in info.get('lap_times', [()])])
    return [*values, times, *(info[name] for name in INFO if name in info)]


def assert_same(name: str, options: dict[str, Any], cars: int, steps: int) -> int:
    """Assert that a batch is its cars one by one; return how many episodes have ended."""
    kinds = {'num_envs': cars, 'max_episode_steps': 200, **options}
    batch = gymnasium.make_vec(IDS[name], vectorization_mode='vector_entry_point', **kinds)
    single = gymnasium.make_vec(IDS[name], vectorization_mode='sync', **kinds)
    assert batch.metadata['autoreset_mode'] == single.metadata['autoreset_mode']
    actions = [*actions_of(batch.action_space.shape, steps)]
    for left, right in zip(rows(batch.reset(seed=3)), rows(single.reset(seed=3)), strict=True):
        np.testing.assert_array_equal(left, right)
    ends = 0
    for action in actions:
        of_batch = rows(batch.step(action))
        of_single = rows(single.step(action))
        for left, right in zip(of_batch, of_single, strict=True):
            np.testing.assert_array_equal(left, right)
        ends += int((of_batch[2] | of_batch[3]).sum())
    return ends


@pytest.mark.parametrize(('name', 'options'), CASES)
def test_a_batch_steps_each_car_as_alone(name: str, options: dict[str, Any]) -> None:
    assert assert_same(name, options, 3, 250) > 0


@pytest.mark.parametrize('name', ['Lane', 'Race'])
def test_a_batch_steps_each_car_as_alone_on_an_open_track(name: str) -> None:
    options = {'track': OPEN, 'noise': NOISE, 'ranges': RANGES, 'dynamics': 'dynamic', 'ts': 0.01}
    assert assert_same(name, options, 3, 250) > 0


def test_a_batch_in_pieces_steps_each_car_as_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(environments, '_MIN_PIECE', 2)
    assert assert_same('Race', {'noise': NOISE, 'ranges': RANGES}, 5, 250) > 0


def test_a_batch_without_numba_steps_each_car_as_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    for module in (batch, environments):
        monkeypatch.setattr(module, 'is_compiled', lambda: False)
    monkeypatch.setattr(environments, 'compiled_for', lambda loop, *_: loop)
    for name, options in CASES[3::5]:
        assert_same(name, options, 2, 60)


@pytest.mark.slow
@pytest.mark.parametrize(
    ('name', 'dynamics'), [('Hills', 'kinematic'), ('Lane', 'kinematic'), ('Race', 'dynamic')]
)
def test_a_batch_steps_each_car_as_alone_over_10_000_steps(name: str, dynamics: str) -> None:
    options = {'dynamics': dynamics, 'noise': NOISE, 'ranges': RANGES, 'ts': 0.01}
    assert assert_same(name, options, 2, 10_000) > 50


@pytest.mark.parametrize('name', IDS)
def test_a_seed_repeats_an_episode_and_another_differs(name: str) -> None:
    env = gymnasium.make_vec(IDS[name], 3, noise=0.1)
    first, again, other = (env.reset(seed=seed)[0] for seed in (1, 1, 2))
    np.testing.assert_array_equal(first, again)
    assert (first != other).any(axis=1).all()
    assert len({*map(tuple, first)}) == 3  # each car has numbers of its own


def test_the_noise_has_the_requested_levels() -> None:
    kinds: dict[str, Any] = {'vectorization_mode': 'vector_entry_point', 'noise': NOISE}
    env = gymnasium.make_vec(IDS['Lane'], 2000, track='oval', **kinds)
    observation, _ = env.reset(seed=1, options={'s': 10.0, 'e_y': 0.0, 'e_psi': 0.0, 'v': 6.0})
    observed = observation[:, :3]
    np.testing.assert_allclose(observed.mean(axis=0), [0.0, 0.0, 6.0], atol=0.005)
    np.testing.assert_allclose(observed.std(axis=0), [NOISE.ey, NOISE.epsi, NOISE.v_x], rtol=0.1)


def drive(env: Any, lane: LaneLQR, steps: int) -> list[tuple[float, float]]:  # noqa: ANN401
    """Return s and e_y of the states of a law that steers."""
    track = env.unwrapped.task.track
    observation, info = env.reset(options={'s': 0.0, 'e_y': 1.0, 'e_psi': 0.0, 'v': 0.0})
    rows = [(info['s'], info['e_y'])]
    for _ in range(steps):
        e_y, e_psi, speed, *_ = map(float, observation)
        steer = lane.steer_calculate(e_y, e_psi, speed, lambda d: track.curvature(info['s'] + d))  # noqa: B023
        observation, _, over, _, info = env.step([steer / 0.5])
        assert not over
        rows.append((info['s'], info['e_y']))
    assert len(info['lap_times']) == 1
    return rows


@pytest.mark.parametrize('dynamics', ['kinematic', 'dynamic'])
def test_a_steering_law_drives_the_trajectory_of_a_run(dynamics: str) -> None:
    log = lap(LaneLQR(), 'oval', speed=8.0, laps=1, e_y=1.0, dynamics=dynamics, delay=0.05)
    env = gymnasium.make(IDS['Lane'], track='oval', speed=8.0, dynamics=dynamics, delay=0.05)
    rows = drive(env, LaneLQR(), len(log) - 1)
    assert rows == list(zip(log.s.tolist(), log.e_y.tolist(), strict=True))


def test_a_lap_ends_no_episode_and_the_edge_does() -> None:
    env = gymnasium.make(IDS['Lane'], track='circle')
    env.reset(options={'s': 0.0, 'e_y': 2.9, 'e_psi': 0.5})
    rewards = []
    over = False
    while not over:
        _, reward, over, truncated, info = env.step([0.0])
        rewards.append(reward)

    assert not truncated
    assert abs(info['e_y']) > 3.0
    assert rewards[-1] < 0.0 < rewards[0]


@pytest.mark.parametrize('mode', ['sync', 'vector_entry_point'])
def test_only_whole_laps_are_timed(mode: str) -> None:
    kinds: dict[str, Any] = {'vectorization_mode': mode, 'track': 'circle', 'speed': 20.0}
    env = gymnasium.make_vec(IDS['Lane'], 2, **kinds)
    beta = np.arcsin(1.5 / 20.0)
    action = np.full((2, 1), np.arctan(2.0 * np.tan(beta)) / 0.5)

    for s, laps in ((0.0, 2), (1.0, 1)):
        env.reset(options={'s': s, 'e_y': 0.0, 'e_psi': -beta, 'v': 20.0})
        for _ in range(640):
            *_, info = env.step(action)
        assert [len(times) for times in info['lap_times']] == [laps, laps]
        assert info['lap_times'][0][-1] == pytest.approx(2.0 * np.pi, rel=0.01)


def test_the_preview_has_the_grades_of_the_road_and_the_curvatures_of_the_track() -> None:
    s = np.linspace(-30.0, 90.0, 977)
    places = np.array([s + d for d in AHEAD])
    road = Road((0.0, 3.0, 50.0), (5.0, -3.0, 1.0))
    assert_ahead(TASKS['Hills'](road=road), s, np.radians(road.grade_deg(places)))
    is_open = Track((10.0, 7.0, 9.0), (0.1, 0.0, -0.1))
    for track in (is_open, Track.named('L')):
        assert_ahead(TASKS['Lane'](track=track), s, track.curvature(places))


def assert_ahead(task: DrivingTask, s: Any, values: Any) -> None:  # noqa: ANN401 (arrays)
    """Assert that these values are ahead of each place, for one car and in the law of a batch."""
    rows = [task.ahead(place) for place in s.tolist()]
    np.testing.assert_array_equal(np.transpose(rows), values)
    table = task.ahead.table
    near = 0
    for place, row in zip(s.tolist(), rows, strict=True):
        near = row_at(table, place, near)
        assert table.rows[near] == row


@pytest.mark.parametrize(
    ('options', 'message'),
    [
        ({'noise': -1.0}, 'noise: -1 is not a number'),
        ({'speed': 'fast'}, "speed: 'fast' is not a number"),
        ({'speed': 0.0}, 'speed: 0 is not a number from 0.001 to 100'),
        ({'colour': 'red'}, "option 'colour' must be one of road,"),
        ({'vehicle': {'mass': 1.0}}, 'must be of type Vehicle'),
        ({'vehicle': [1.0]}, 'has 1 numbers: expected mass, air_drag_coeff'),
        ({'vehicle': [-1.0, 0, 0, 1, 1, 9]}, 'mass: -1 is not a number'),
        ({'track': {'name': 'L'}}, 'must have lengths, curvatures'),
        ({'track': 'nowhere'}, "track 'nowhere' is neither"),
        ({'ranges': {'colour': (0.0, 1.0)}}, "ranges: 'colour' must be one of mass,"),
        ({'ranges': [1]}, r'ranges: \[1\] is not a dict: give each value by its name'),
        ({'ranges': {'mass': (0.0, 10.0)}}, 'ranges: mass: 0 is not a number'),
        ({'ranges': {'mass': 5}}, r'ranges: mass: 5 is not a pair of numbers: give \(lowest, high'),
        ({'ranges': {'front_stiffness': (1.0, 1e8)}, 'dynamics': 'dynamic'}, 'steps of 0.02 s'),
    ],
)
def test_an_invalid_option_is_refused_in_a_sentence(options: dict[str, Any], message: str) -> None:
    with pytest.raises(UserError, match=message):
        gymnasium.make(IDS['Lane'], **options)


@pytest.mark.parametrize('name', IDS)
@pytest.mark.parametrize('mode', ['sync', 'vector_entry_point'])
def test_an_environment_takes_its_options_from_a_scenario(name: str, mode: str) -> None:
    options: dict[str, Any] = {**ELSEWHERE[name], 'noise': NOISE, 'dynamics': 'dynamic'}
    ranges = options.pop('ranges', {})
    of_scenario = Scenario(speed_reference=7.0, max_duration=5.0, **options)
    envs = [
        gymnasium.make_vec(IDS[name], 2, vectorization_mode=mode, ranges=ranges, **each)
        for each in (dict(speed=7.0, **options), {'scenario': of_scenario})
    ]

    np.testing.assert_array_equal(*(env.reset(seed=1)[0] for env in envs))
    for action in actions_of(envs[0].action_space.shape, 50):
        np.testing.assert_array_equal(*(env.step(action)[0] for env in envs))


@pytest.mark.parametrize('mode', ['sync', 'vector_entry_point'])
@pytest.mark.parametrize('delay', [0.0, 0.05])
def test_a_seed_gives_the_measurements_of_a_run_with_this_seed(mode: str, delay: float) -> None:
    options: dict[str, Any] = {'noise': NOISE, 'sensor_delay': delay}
    logs = [simulate(seed=seed, distance=20.0, **options) for seed in (5, 6)]
    steps = min(map(len, logs))
    assert steps > 130  # more than two blocks of noise

    env = gymnasium.make_vec(IDS['Hills'], 2, vectorization_mode=mode, **options)
    speeds = [env.reset(seed=5, options={'s': 0.0, 'v': 0.0})[0][:, 1]]
    for k in range(steps - 1):
        actions = np.array([[log.motor[k] / 8.0] for log in logs])
        speeds.append(env.step(actions)[0][:, 1])
    expected = np.column_stack([log.v_x[:steps] for log in logs])
    np.testing.assert_array_equal(speeds, expected)


@pytest.mark.parametrize('mode', ['sync', 'vector_entry_point'])
def test_the_start_of_a_seed_does_not_change_its_noise(mode: str) -> None:
    observed = []
    for ranges in ({}, {'mass': (1000.0, 3000.0)}):
        for noise in (0.0, NOISE):
            env = gymnasium.make_vec(
                IDS['Hills'], 2, vectorization_mode=mode, noise=noise, ranges=ranges
            )
            observed.append(env.reset(seed=4)[0][:, 1])
    exact, noisy, exact_of_ranges, noisy_of_ranges = observed
    errors = Sensor(NOISE, 4).errors(1)[0, 3], Sensor(NOISE, 5).errors(1)[0, 3]

    np.testing.assert_array_equal(noisy, exact + errors)
    np.testing.assert_array_equal(noisy_of_ranges, exact_of_ranges + errors)
    np.testing.assert_array_equal(exact, exact_of_ranges)


@pytest.mark.parametrize(
    ('scenario', 'message'),
    [
        (Scenario(track='L', kp=1.0), 'has kp, which is no option of Lane-v0: leave it out'),
        (Scenario(track='L', seed=3), 'has seed, which is no option of Lane-v0: leave it out'),
        (Scenario(track='L', e_y=1.0), 'has e_y, which is no option of Lane-v0: leave it out'),
        (Scenario(), 'Lane-v0 needs a track'),
        (Scenario(track='L', speed_reference=-1.0), 'speed_reference: -1 is not a number from'),
        ('L', 'must be of type Scenario, such as Scenario'),
        ({'colour': 'red'}, "scenario: 'colour' must be one of road, track"),
    ],
)
def test_a_scenario_that_makes_no_environment_is_refused(scenario: object, message: str) -> None:
    with pytest.raises(UserError, match=message):
        gymnasium.make(IDS['Lane'], scenario=scenario)
    with pytest.raises(UserError, match='acceleration_limit beside a scenario'):
        gymnasium.make(IDS['Lane'], scenario=Scenario(track='L'), acceleration_limit=2.0)


@pytest.mark.parametrize('mode', ['sync', 'vector_entry_point'])
@pytest.mark.parametrize(
    ('options', 'message'),
    [
        ([1], r'options: \[1\] is not a dict'),
        ({'x': 0.0}, "options: 'x' must be one of s, v, e_y, e_psi"),
        ({'s': 'x'}, "options: s: 'x' is not a number from 0 to 174.556"),
        ({'e_y': 99}, 'options: e_y: 99 is not a number from -3 to 3'),
        ({'v': np.inf}, 'options: v: inf is not a number from -50 to 50'),
        ({'v': np.nan}, 'options: v: nan is not a number'),
    ],
)
def test_an_invalid_start_is_refused(mode: str, options: object, message: str) -> None:
    env = gymnasium.make_vec(IDS['Race'], 2, vectorization_mode=mode)
    with pytest.raises(UserError, match=message):
        env.reset(options=options)


@pytest.mark.parametrize('mode', ['sync', 'vector_entry_point'])
def test_an_invalid_action_is_refused(mode: str) -> None:
    env = gymnasium.make_vec(IDS['Race'], 2, vectorization_mode=mode)
    env.reset()
    for action in ([0.0, np.nan], [0.0], [0.0, 0.0, 0.0]):
        with pytest.raises(UserError, match='takes a list of motor and servo, from -1 to 1'):
            env.step(np.array([action, action], np.float32))


@pytest.mark.parametrize('mode', ['sync', 'vector_entry_point'])
def test_no_step_comes_before_a_reset(mode: str) -> None:
    env = gymnasium.make_vec(IDS['Lane'], 2, vectorization_mode=mode)
    with pytest.raises(gymnasium.error.ResetNeeded):
        env.step(np.zeros((2, 1)))


def test_the_task_hills_has_no_track() -> None:
    with pytest.raises(UserError, match="option 'track' must be one of road, vehicle"):
        gymnasium.make(IDS['Hills'], track='L')


@pytest.mark.parametrize('name', IDS)
def test_a_pickled_environment_continues_as_the_original(name: str) -> None:
    """Gymnasium's AsyncVectorEnv, and Stable-Baselines3, send them to other processes."""
    original = gymnasium.make(IDS[name], render_mode='rgb_array', noise=NOISE)
    batch = gymnasium.make_vec(IDS[name], 2, vectorization_mode='vector_entry_point', noise=NOISE)
    for env in (original, batch):
        before = pickle.loads(pickle.dumps(env))  # noqa: S301 (our own)
        before.reset(seed=1)
        env.reset(seed=1)
        if env is original:
            env.render()
        after = pickle.loads(pickle.dumps(env))  # noqa: S301
        action = np.full_like(env.action_space.sample(), 0.1)
        for _ in range(70):
            observation, *_ = env.step(action)
            np.testing.assert_array_equal(before.step(action)[0], observation)
            np.testing.assert_array_equal(after.step(action)[0], observation)

    assert after.unwrapped is not env


@pytest.mark.parametrize(
    'options',
    [
        {'vehicle': Vehicle(mass=1000.0)},
        {'servo': Actuator(lag=0.2), 'noise': NOISE},
        {'track': Track.named('oval'), 'road': Road((0.0, 30.0), (5.0, -3.0))},
        {'dynamics': 'dynamic', 'lateral': LateralParameters(yaw_inertia=3000.0)},
        {'motor': Actuator(lag=0.2, limit=5.0), 'disturbance': GUST, 'integrator': 'rk4'},
        {'scenario': SCENARIO},
    ],
)
def test_a_specification_in_json_makes_the_same_environment(options: dict[str, Any]) -> None:
    from_json = gymnasium.envs.registration.EnvSpec.from_json
    env = gymnasium.make(IDS['Race'], **options)
    again = gymnasium.make(from_json(env.spec.to_json()))
    action = np.array([0.2, 0.1], np.float32)
    np.testing.assert_array_equal(env.reset(seed=3)[0], again.reset(seed=3)[0])
    for _ in range(20):
        np.testing.assert_array_equal(env.step(action)[0], again.step(action)[0])


def test_a_specification_of_a_batch_in_json_makes_the_same_batch() -> None:
    kinds: dict[str, Any] = {'vectorization_mode': 'vector_entry_point', 'scenario': SCENARIO}
    batch = gymnasium.make_vec(IDS['Race'], 2, **kinds)
    spec = gymnasium.envs.registration.EnvSpec.from_json(batch.spec.to_json())
    again = gymnasium.make_vec(spec, 2)
    np.testing.assert_array_equal(batch.reset(seed=3)[0], again.reset(seed=3)[0])


def test_a_batch_takes_a_seed_for_each_car() -> None:
    """As Gymnasium's own vector environments do; None leaves a car's generator as it is."""
    envs = [
        gymnasium.make_vec(IDS['Lane'], 3, vectorization_mode=mode)
        for mode in ('sync', 'vector_entry_point')
    ]

    for seed in ([5, 1, 8], [2, None, None], 4, None):
        np.testing.assert_array_equal(*[env.reset(seed=seed)[0] for env in envs])
    with pytest.raises(UserError, match='must be one number, or one for each of 3 cars'):
        envs[1].reset(seed=[1, 2])


def test_an_environment_without_a_wrapper_needs_a_reset_first() -> None:
    env = gymnasium.make(IDS['Lane'], render_mode='rgb_array').unwrapped
    with pytest.raises(gymnasium.error.ResetNeeded, match=r'call reset\(\) before step\(\)'):
        env.step([0.0])
    with pytest.raises(gymnasium.error.ResetNeeded, match=r'call reset\(\) before render\(\)'):
        env.render()
