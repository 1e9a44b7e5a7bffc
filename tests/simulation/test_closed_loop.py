"""The closed loop, `simulate`, the fast loop, and the end of a car that never arrives."""

from __future__ import annotations

from functools import partial
from math import inf, nan, radians
from typing import TYPE_CHECKING

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from barc_sim.control.speed import PID, speed_controller
from barc_sim.errors import UserError
from barc_sim.simulation.closed_loop import STALL_TIMEOUT, Progress, closed_loop, simulate
from barc_sim.simulation.metrics import summary
from barc_sim.vehicle.bike_model import BicycleState, Vehicle, bikeFE
from barc_sim.vehicle.parameters import PARAMETERS, PlantOptions
from barc_sim.vehicle.plant import Actuator, NoiseLevels, Plant
from barc_sim.vehicle.road import Road
from barc_sim.vehicle.track import Track

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from barc_sim.simulation.log import Log


@pytest.fixture(scope='module')
def lab_run() -> Log:
    return closed_loop()


# The defaults


def test_closed_loop_is_the_lab_templates_loop(lab_run: Log) -> None:
    """A user's plain loop over bikeFE and the controller, with nothing else of ours."""
    x = y = psi = v = 0.0
    pid, road, vehicle = speed_controller(), Road.lab(), Vehicle()
    states, commands = [], []
    while True:
        a = pid.acc_calculate(8.0, v)
        states.append((x, y, psi, v))
        commands.append(a)
        if x >= 180.0:
            break
        theta = radians(road.grade_deg(x))
        x, y, psi, v = bikeFE(
            x, y, psi, v, a, 0.0, vehicle.air_drag_coeff, 2000.0, vehicle.friction, theta, 0.02
        )
    columns = [lab_run.x, lab_run.y, lab_run.psi, lab_run.v_x]

    assert np.array_equal(np.column_stack(columns), np.array(states))
    assert np.array_equal(lab_run.motor, np.array(commands))


# Where it ends


@pytest.mark.parametrize('distance', [5.0, 42.0, 180.0])
def test_last_row_is_the_first_state_at_or_beyond_the_distance(distance: float) -> None:
    log = closed_loop(distance=distance)
    assert log.x[-1] >= distance > log.x[-2]


def test_true_position_ends_the_run() -> None:
    plant = Plant(noise=NoiseLevels(s=5.0), seed=1)
    log = closed_loop(plant, distance=30.0)
    assert log.distance[-1] >= 30.0
    assert log.distance[-2] < 30.0 < log.x[:-1].max()


@pytest.mark.parametrize(('duration', 'states'), [(0.0, 1), (0.06, 4), (1.0, 51)])
def test_run_that_does_not_arrive_ends_after_its_longest_duration(
    duration: float, states: int
) -> None:
    log = closed_loop(max_duration=duration)
    assert len(log) == states
    assert log.t[-1] == pytest.approx(duration)


def test_a_step_counts_in_whole_nanoseconds_as_the_nodes_rate_does() -> None:
    values = {row.name: row.default for row in PARAMETERS} | {'rate': 333.0}
    of_node = PlantOptions.of_parameters(values)
    assert simulate(ts=1 / 333, distance=30.0) == closed_loop(of_node.plant(), distance=30.0)


def assert_same(left: Log, right: Log) -> None:
    for column, other_column in zip(left.columns().values(), right.columns().values(), strict=True):
        assert column.tobytes() == other_column.tobytes()


def test_keywords_make_plant_and_controller() -> None:
    vehicle = Vehicle(mass=1000.0)
    log = simulate(
        10.0,
        20.0,
        0.5,
        road='flat',
        vehicle=vehicle,
        noise=0.1,
        delay=0.04,
        speed_reference=5.0,
        distance=30.0,
        seed=3,
        acceleration_limit=4.0,
        integrator='rk4',
        ts=0.01,
    )
    plant = Plant(
        road=Road.flat(),
        vehicle=vehicle,
        noise=NoiseLevels(v_x=0.1),
        seed=3,
        motor=Actuator(delay=0.04),
        integrator='rk4',
        ts=0.01,
    )
    pid = speed_controller(10.0, 20.0, 0.5, limit=4.0)

    assert_same(log, closed_loop(plant, pid, speed_reference=5.0, distance=30.0))


def test_a_road_is_an_object_a_name_or_a_file(tmp_path: Path) -> None:
    file = tmp_path / 'hills.csv'
    file.write_text('start_m,grade_deg\n0,0\n10,5\n')
    road = Road((0.0, 10.0), (0.0, 5.0))
    assert_same(simulate(road=file, distance=30.0), simulate(road=road, distance=30.0))
    assert_same(simulate(road=str(file), distance=30.0), simulate(road=road, distance=30.0))
    with pytest.raises(UserError, match=r"road 'nowhere.csv' is neither"):
        simulate(road='nowhere.csv')


class LabPid:
    """As students write it."""

    def __init__(self) -> None:
        self.integral = 0.0

    def acc_calculate(self, speed_reference: float, speed_current: float) -> float:
        """Return the acceleration."""
        error = speed_reference - speed_current
        self.integral += 20.0 * error * 0.02
        return 10.0 * error + self.integral


def test_a_controller_of_two_arguments_drives_within_the_limit_from_its_beginning() -> None:
    pid = LabPid()
    first, second = simulate(controller=pid), simulate(controller=pid)
    assert first.x[-1] >= 180.0
    assert np.abs(first.motor).max() == 8.0
    assert_same(first, second)


def test_a_model_is_called_as_bikefe() -> None:
    def lab_model(*args: float) -> list[float]:
        return bikeFE(*args)

    def with_options(*args: float, l_f: float, l_r: float, g: float) -> list[float]:
        return bikeFE(*args, l_f=l_f, l_r=l_r, g=g)

    expected = simulate(distance=30.0)
    assert_same(simulate(model=lab_model, distance=30.0), expected)
    assert_same(simulate(model=with_options, distance=30.0), expected)


# A reference that changes, a disturbance


def test_the_log_and_the_scores_follow_a_reference_over_time(tmp_path: Path) -> None:
    file = tmp_path / 'reference.csv'
    file.write_text('time_s,speed_mps\n0,4\n5,4\n5,9\n8,6\n', encoding='utf-8')
    log = simulate(reference=file)
    assert log.reference[[0, 249, 250, 325, -1]].tolist() == [4.0, 4.0, 9.0, 7.5, 6.0]
    assert np.abs(log.speed_error[log.t > 9.0]).max() < 0.2
    before = log.map(lambda column: column[:250])
    assert summary(log).overshoot == summary(before).overshoot < 0.05
    assert (summary(log).max_error, summary(before).max_error) == (5.0, 4.0)


def test_a_function_of_the_measured_place_is_a_reference(tmp_path: Path) -> None:
    file = tmp_path / 'reference.csv'
    file.write_text('distance_m,speed_mps\n0,4\n50,4\n50,6\n', encoding='utf-8')
    log = simulate(reference=lambda _, x: 4.0 if x < 50.0 else 6.0, noise=NoiseLevels(s=0.5))
    assert log == simulate(reference=file, noise=NoiseLevels(s=0.5))
    assert (log.reference == np.where(log.x < 50.0, 4.0, 6.0)).all()


def test_a_constant_function_is_the_number() -> None:
    run = partial(simulate, distance=30.0)
    assert run(reference=lambda *_: 5.0) == run(speed_reference=5.0)
    wind = run(disturbance=-900.0)
    assert wind == run(disturbance=lambda *_: -900.0)
    assert wind != run()


def test_a_late_sensor_makes_the_loop_overshoot() -> None:
    punctual = simulate(road='flat')
    late = simulate(road='flat', sensor_delay=0.06)
    assert summary(late).overshoot > 2.0 * summary(punctual).overshoot
    assert late.speed[:-3] == pytest.approx(late.v_x[3:])


TS = 0.02
LAB = 180.0  #: [m]
Motion = tuple[float, float]  #: x [m], v [m/s]


def follow(
    motion: Callable[[float], Motion],
    *,
    distance: float = LAB,
    duration: float = 300.0,
    reference: Callable[[float], float] = lambda _: 8.0,
) -> tuple[float, str]:
    """Return when [s] a car that moves so is given up, and why; infinity if it never is."""
    progress = Progress(distance)
    for k in range(round(duration / TS)):
        t = k * TS
        x, v = motion(t)
        if progress.add(t, x, v, reference(t)):
            return t, progress.failure
    return inf, progress.failure


@pytest.mark.parametrize(
    ('motion', 'gave_up', 'does'),
    [
        (lambda _: (8.0, 8.0), 20.0, 'is at 8.0 m, at 8.00 m/s, and was at 8.0 m: the model must'),
        (lambda _: (0.0, 0.0), 20.0, 'stands at 0.0 m: the commands do not move it'),
        (lambda t: (-t, -1.0), 20.0, 'drives backwards, to -20.02 m: the error is'),
        (
            lambda t: (max(0.0, 9.0 - t), -1.0),
            20.0,
            'is at 0.0 m, at -1.00 m/s, and was at 9.0 m: the commands may be too small',
        ),
        (lambda _: (nan, 1.0), 20.0, 'is at nan m, at 1.00 m/s'),
        (lambda t: (-(5.0**t), -(5.0**t)), 4.3, 'drives backwards, to -1013 m: the error is'),
        (lambda t: (1.0, 5.0**t), 4.3, 'gets faster and faster: a sign is wrong, or a gain'),
    ],
)
def test_a_run_ends_if_the_car_never_arrives(
    motion: Callable[[float], Motion], gave_up: float, does: str
) -> None:
    t, failure = follow(motion)

    assert t == pytest.approx(gave_up, abs=2 * TS)
    assert failure.startswith(f'the car {does}')


@pytest.mark.parametrize(
    ('motion', 'options'),
    [
        (lambda t: (0.1 * t, 0.1), {}),
        (lambda t: (max(t - 19.0, 0.0) * 8.0, 8.0), {}),
        (lambda _: (0.0, 0.0), {'distance': inf}),
        (lambda _: (LAB, 0.0), {}),
    ],
)
def test_a_car_that_makes_progress_does_not_end_the_run(
    motion: Callable[[float], Motion], options: dict[str, float]
) -> None:
    assert follow(motion, **options) == (inf, '')  # type: ignore[arg-type]


def test_a_car_that_stops_at_reference_zero_does_not_end_the_run() -> None:
    def motion(t: float) -> Motion:
        return (8.0 * min(t, 5.0), 0.0 if t > 5.0 else 8.0)

    assert follow(motion, reference=lambda t: 8.0 if t < 5.0 else 0.0)[0] == inf
    assert follow(motion)[0] == pytest.approx(5.0 + STALL_TIMEOUT, abs=2 * TS)
    assert follow(lambda _: (0.0, 0.0), reference=lambda _: 0.0)[0] == pytest.approx(
        STALL_TIMEOUT, abs=2 * TS
    )


NOISE = NoiseLevels(s=0.1, ey=0.05, epsi=0.01, v_x=0.05, v_y=0.02)


class General(PID):
    """A PID that the general loop drives: it is not exactly `PID`."""


roads = st.lists(st.tuples(st.floats(0.5, 20.0), st.floats(-60.0, 60.0)), min_size=1, max_size=5)


@settings(max_examples=40, deadline=None)
@given(
    stretches=roads,
    state=st.builds(
        BicycleState,
        st.floats(-5.0, 5.0),
        st.floats(-2.0, 2.0).map(lambda y: y or 0.0),
        st.just(0.0),
        st.floats(-5.0, 12.0),
    ),
    resistance=st.tuples(st.floats(500.0, 3000.0), st.floats(0.0, 50.0), st.floats(0.0, 500.0)),
    gains=st.tuples(st.floats(-2.0, 80.0), st.floats(0.0, 3000.0), st.floats(0.0, 3.0)),
    low=st.sampled_from([-8.0, -1.0, -inf]),
    high=st.sampled_from([8.0, 2.0, inf]),
    reference=st.floats(-3.0, 12.0),
    ts=st.sampled_from([0.02, 0.013, 1.0 / 30.0]),
    noise=st.sampled_from([NoiseLevels(), NoiseLevels(v_x=0.3), NOISE]),
    delay=st.just(0.0) | st.floats(0.0, 0.2) | st.integers(1, 5).map(lambda n: n * 0.02),
)
def test_the_log_is_that_of_the_general_loop(
    stretches: list[tuple[float, float]],
    state: BicycleState,
    resistance: tuple[float, float, float],
    gains: tuple[float, float, float],
    low: float,
    high: float,
    reference: float,
    ts: float,
    noise: NoiseLevels,
    delay: float,
) -> None:
    starts = [sum(length for length, _ in stretches[:i]) for i in range(len(stretches))]
    road = Road(tuple(starts), tuple(grade for _, grade in stretches))
    logs = []
    for make in (PID, General):
        plant = Plant(
            road=road,
            vehicle=Vehicle(*resistance),
            ts=ts,
            noise=noise,
            seed=3,
            motor=Actuator(delay=delay),
        )
        plant.place(state)
        pid = make(*gains, output_min=low, output_max=high)
        log = closed_loop(plant, pid, speed_reference=reference, distance=20.0, max_duration=8.0)
        logs.append([each.tobytes() for each in log.columns().values()])

    assert logs[0] == logs[1]


def test_numbers_that_grow_without_bound_are_those_of_the_general_loop() -> None:
    controllers = [PID(), General()]
    for law in controllers:
        law.kp = -1e200
    logs = [closed_loop(controller=law, max_duration=1.0) for law in controllers]
    left, right = ([law.tobytes() for law in log.columns().values()] for log in logs)
    assert left == right


def test_a_controller_without_a_number_brings_the_car_nowhere() -> None:
    pid = PID()
    pid.kp = nan
    assert len(closed_loop(controller=pid, max_duration=0.2)) == 11


def test_a_car_with_a_users_model_or_a_track_has_no_fast_path() -> None:
    assert not Plant(model=lambda *_, **__: (0.0,) * 4).has_fast_path
    assert not Plant(track=Track.named('oval')).has_fast_path
    assert not Plant(sensor_delay=0.04).has_fast_path
    assert Plant(noise=NOISE, motor=Actuator(delay=0.03, lag=0.1)).has_fast_path
    assert Plant(integrator='rk4').has_fast_path
    assert Plant(dynamics='dynamic').has_fast_path
