"""`sweep` under every law: the scores of each run to the last bit, compiled or not."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import pytest

from barc_sim.control.lane import LaneLQR, PurePursuit, Stanley, speed_profile
from barc_sim.control.pilots import LanePilot, SpeedPilot
from barc_sim.control.speed import LQR, PID
from barc_sim.errors import UserError
from barc_sim.simulation import law_runs, many_runs, rollout
from barc_sim.simulation.closed_loop import drive_scenario, lap, simulate
from barc_sim.simulation.log import TrackLog
from barc_sim.simulation.metrics import rms, summary
from barc_sim.simulation.scenario import Scenario
from barc_sim.tuning.sweep import LANE_SCORES, SCORES, sweep
from barc_sim.vehicle.bicycles import LateralParameters
from barc_sim.vehicle.bike_model import Vehicle, bikeFE
from barc_sim.vehicle.law import compiled, is_compiled
from barc_sim.vehicle.plant import Actuator, NoiseLevels
from barc_sim.vehicle.road import Road
from barc_sim.vehicle.track import Track

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from barc_sim.control.lane import Curvature
    from barc_sim.simulation.log import Log
    from barc_sim.tuning.sweep import Sweep

needs_numba = pytest.mark.skipif(not is_compiled(), reason='needs the extra fast')
SPEED_LAWS: dict[type[Any], dict[str, tuple[float, float]]] = {
    PID: {'kp': (2.0, 60.0), 'ki': (0.0, 250.0), 'kd': (0.0, 0.5)},
    LQR: {'speed_weight': (1.0, 900.0), 'observer_gain': (0.0, 1.0)},
}
LANE_LAWS: dict[type[Any], dict[str, tuple[float, float]]] = {
    LaneLQR: {'q_e_y': (0.01, 0.5), 'q_e_psi': (0.0, 2.0), 'preview': (0.0, 0.2)},
    Stanley: {'k': (0.5, 5.0), 'v_soft': (0.5, 3.0)},
    PurePursuit: {'look_ahead': (1.0, 5.0), 'look_ahead_time': (0.0, 0.4)},
}
SMALL = Track((44.0,), (2.0 * np.pi / 44.0,), name='small')
OPEN = Track((20.0, 15.0, 30.0), (0.0, 0.05, -0.02), name='open')


class Drawn(NamedTuple):
    """A scenario, and the gains that are swept in it, by name; a column for each run."""

    scenario: Scenario
    gains: Mapping[str, Sequence[float]]


def drawn(number: int) -> Drawn:
    """Draw a scenario: course, car, actuators, sensor, laws and their gains."""
    random = np.random.default_rng(number)

    def some(share: float, low: float, high: float) -> float:
        return float(random.uniform(low, high)) if random.random() < share else 0.0

    noise = 0.05 * (random.random() < 0.5)
    laws = [random.choice([*SPEED_LAWS])]
    options: dict[str, Any] = {
        'road': Road((0.0, 9.0, 21.0), (0.0, float(random.uniform(-8.0, 8.0)), 2.0)),
        'speed_reference': float(random.uniform(2.0, 6.0)),
        'acceleration_limit': float(random.choice([4.0, 8.0])),
        'distance': 25.0,
        'ts': float(random.choice([0.02, 0.0125])),
        'seed': int(random.integers(0, 2**40)),
        'noise': NoiseLevels(s=noise, ey=0.2 * noise, epsi=0.2 * noise, v_x=noise),
        'sensor_delay': some(0.3, 0.0, 0.1),
        'integrator': str(random.choice(['euler', 'rk4'])),
        'dynamics': str(random.choice(['kinematic', 'dynamic'])),
        'lateral': LateralParameters(dynamic_above=3.0),
        'vehicle': Vehicle(
            mass=int(random.integers(1000, 2500)),
            air_drag_coeff=some(0.7, 0.0, 3.0),
            friction=some(0.7, 0.0, 300.0),
            l_f=float(random.uniform(1.0, 2.0)),
            l_r=float(random.uniform(1.0, 2.0)),
        ),
        'disturbance': some(0.3, -300.0, 300.0),
        'motor': Actuator(delay=some(0.6, 0.0, 0.1), lag=some(0.4, 0.02, 0.3)),
    }
    if random.random() < 0.7:
        laws.append(random.choice([*LANE_LAWS]))
        track = random.choice([SMALL, OPEN, Track.named('oval'), Track.named('figure-eight')])
        options |= {
            'track': track,
            'lane': laws[1](),
            'e_y': some(0.3, -1.0, 1.0),
            'servo': Actuator(
                delay=some(0.5, 0.0, 0.1),
                lag=some(0.7, 0.02, 0.3),
                rate=float(random.uniform(0.5, 2.0)),
                limit=0.4,
            ),
        }
        if track is SMALL:
            options |= {'laps': int(random.integers(1, 4)), 'distance': 0.0}
        if random.random() < 0.3:
            options['reference'] = speed_profile(track, options['speed_reference'], 1.5, 1.0)
    ranges: dict[str, tuple[float, float]] = {}
    for law in laws:
        ranges |= (SPEED_LAWS | LANE_LAWS)[law]
    gains = {name: random.uniform(*limits, 2).tolist() for name, limits in ranges.items()}
    return Drawn(Scenario(controller=laws[0](), max_duration=40.0, **options), gains)


def log_of(run: Drawn, i: int) -> Log:
    """Return the log of a run of a sweep, which `simulate` makes."""
    scenario = run.scenario
    kinds = [type(scenario.controller)]
    if scenario.lane is not None:
        kinds.append(type(scenario.lane))
    laws: list[Any] = [
        kind(**{name: run.gains[name][i] for name in kind.gains if name in run.gains})
        for kind in kinds
    ]
    changed = replace(scenario, controller=laws[0])
    return drive_scenario(replace(changed, lane=laws[1]) if len(laws) > 1 else changed)


def scores_of(log: Log, end: float) -> list[float]:
    """Return the scores of a run."""
    is_on_track = isinstance(log, TrackLog)
    if log.distance[-1] < end:
        return [np.inf] * (7 if is_on_track else 4)
    result = summary(log)
    scores = [
        result.rms_error_after_run_up,
        result.max_error_after_run_up,
        result.overshoot,
        rms(log.motor),
    ]
    if isinstance(log, TrackLog):
        scores += [rms(log.e_y), float(np.abs(log.e_y).max()), log.best]
    return scores


def rows_of(swept: Sweep) -> list[list[float]]:
    """Return the scores of each run."""
    names = SCORES | LANE_SCORES if 'max_e_y' in (swept.dtype.names or ()) else SCORES
    return [[float(each[name]) for name in names] for each in swept.flat]


@pytest.fixture(params=[pytest.param(True, marks=needs_numba), False], ids=['compiled', 'python'])
def loops(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """Compile the loops, or run them in Python."""
    if request.param:
        return
    for module in (law_runs, many_runs, rollout):
        monkeypatch.setattr(module, 'is_compiled', lambda: False)
    for module in (law_runs, rollout):
        monkeypatch.setattr(module, 'compiled', lambda loop: loop)


@pytest.mark.usefixtures('loops')
@pytest.mark.parametrize(
    'numbers', [range(40), pytest.param(range(40, 240), marks=pytest.mark.slow)], ids=len
)
def test_a_sweep_has_the_scores_of_simulate_to_the_last_bit(numbers: range) -> None:
    arrived = 0
    for number in numbers:
        run = drawn(number)
        found = rows_of(sweep(scenario=run.scenario, **run.gains))
        expected = [scores_of(log_of(run, i), run.scenario.end) for i in range(2)]
        assert found == expected, (number, run)
        arrived += int(np.isfinite(found).all(axis=1).sum())
    assert arrived > 0.6 * len(numbers)


@needs_numba
def test_one_compiled_loop_drives_all_cars_under_all_laws() -> None:
    loop: Any = compiled(law_runs.score_drives)
    for number in range(20):
        run = drawn(number)
        sweep(scenario=run.scenario, **run.gains)
    assert len(loop.signatures) == 1


@pytest.mark.usefixtures('loops')
def test_each_seed_scores_its_laps() -> None:
    options: dict[str, Any] = {'track': SMALL, 'laps': 2, 'noise': 0.1}
    found = sweep(seed=[5, 3, 5], speed_reference=4.0, **options)
    assert found.seed.tolist() == [5, 3, 5]
    for i, seed in enumerate(found.seed):
        log = lap(speed=4.0, seed=int(seed), **options)
        assert rows_of(found)[i] == scores_of(log, 2 * SMALL.length)


@pytest.mark.usefixtures('loops')
def test_a_run_that_takes_long_has_the_noise_of_simulate_to_its_end() -> None:
    options: dict[str, Any] = {'noise': 0.1, 'distance': 30.0, 'ts': 0.001, 'seed': 4}
    (found,) = rows_of(sweep(controller=LQR(), speed_weight=[2.0], **options))
    log = simulate(controller=LQR(speed_weight=2.0), **options)
    assert len(log) > 2048
    assert found == scores_of(log, 30.0)


@pytest.mark.usefixtures('loops')
def test_a_car_that_leaves_its_track_has_infinite_scores() -> None:
    found = sweep(track='oval', laps=1, lane=PurePursuit(), look_ahead=[50.0, 2.0])
    assert np.isinf(rows_of(found)[0]).all()
    assert np.isfinite(rows_of(found)[1]).all()


def test_gains_of_both_laws_are_broadcast_and_tabled_by_name() -> None:
    found = sweep([[10.0], [30.0]], track=SMALL, laps=1, lane=LaneLQR(), q_e_y=[0.05, 0.1, 0.2])
    assert found.shape == (2, 3)
    names = [*PID.gains, *LaneLQR.gains, *SCORES, *LANE_SCORES]
    assert [*found.dtype.names] == names  # type: ignore[misc]
    assert found.q_e_y[1].tolist() == [0.05, 0.1, 0.2]
    assert sweep(30.0, track=SMALL, laps=1, **{'lane.q_e_y': 0.1}).max_e_y == found.max_e_y[1, 1]


class Swerving(LaneLQR):
    """A law of a user's, whose gain has the name of one of the PID's."""

    gains = LaneLQR.gains | {'kp': PID.gains['kp']}
    calls = 0

    def steer_calculate(
        self, e_y: float, e_psi: float, speed: float, curvature: Curvature
    ) -> float:
        """Return the angle of the regulator, and a bit more."""
        Swerving.calls += 1
        kp: float = self.kp  # type: ignore[attr-defined]
        return super().steer_calculate(e_y, e_psi, speed, curvature) + 0.001 * kp


def test_a_users_law_drives_in_python() -> None:
    lane = Swerving(kp=2.0)
    Swerving.calls = 0
    found = sweep(kp=30.0, track=SMALL, laps=1, lane=lane, **{'lane.kp': [0.0, 2.0]})
    assert Swerving.calls > 500
    assert found.dtype.names[:7] == (*PID.gains, *LaneLQR.gains, 'lane.kp')  # type: ignore[index]
    log = lap(lane, SMALL, laps=1, speed=8.0)
    assert rows_of(found)[1] == scores_of(log, SMALL.length)


def test_a_users_model_and_controller_drive_in_python() -> None:
    calls = 0

    class Half(LQR):
        """A controller that commands half of the acceleration."""

        def acc_calculate(self, reference: float, speed: float, dt: float | None = None) -> float:
            """Return the acceleration."""
            return 0.5 * super().acc_calculate(reference, speed, dt)

    def model(*state_and_input: float) -> list[float]:
        nonlocal calls
        calls += 1
        return bikeFE(*state_and_input)

    options: dict[str, Any] = {'controller': Half(), 'model': model, 'distance': 20.0}
    found = sweep(speed_weight=[100.0, 400.0], **options)
    assert calls > 200
    assert options['controller'].speed_weight == 400.0
    assert rows_of(found)[1] == scores_of(simulate(**options), 20.0)


def test_pilots_are_swept_as_simulate_takes_them() -> None:
    speed, lane = SpeedPilot(LQR()), LanePilot(Stanley())
    found = sweep(controller=speed, lane=lane, track=SMALL, laps=1, k=[1.0, 3.0])
    log = lap(Stanley(k=3.0), SMALL, laps=1, speed=8.0, controller=LQR())
    assert rows_of(found)[1] == scores_of(log, SMALL.length)
    assert lane.controller.k == 2.0  # type: ignore[attr-defined]


@pytest.mark.parametrize(
    ('options', 'complaint'),
    [
        ({'lane': Stanley(), 'track': 'oval', 'k': [1.0, -1.0]}, 'lane.k: -1 is not a number'),
        ({'lane': Stanley(), 'k': 1.0}, 'needs a track'),
        ({'laps': 2}, 'laps=2 needs a track'),
        ({'track': 'oval', 'laps': 10**6}, 'distance: '),
    ],
)
def test_what_cannot_be_swept_is_refused(options: dict[str, Any], complaint: str) -> None:
    with pytest.raises(UserError, match=complaint):
        sweep(**options)
