"""A drawn scenario is the same run by `simulate`, and by what the nodes are without ROS."""

from __future__ import annotations

from math import inf
from typing import TYPE_CHECKING, Any

from hypothesis import assume, given, settings
from hypothesis import strategies as st

from barc_sim.control.cruise_control import CruiseControl
from barc_sim.control.lane import LaneLQR, Stanley
from barc_sim.errors import UserError
from barc_sim.simulation.closed_loop import simulate
from barc_sim.simulation.scenario import Scenario
from barc_sim.simulation.stepper import Phase, Stepper, StepperOptions, parameters
from barc_sim.vehicle.bicycles import LateralParameters
from barc_sim.vehicle.bike_model import Vehicle
from barc_sim.vehicle.plant import Actuator, NoiseLevels
from barc_sim.vehicle.road import Road

if TYPE_CHECKING:
    from barc_sim.interfaces.parameters import ParameterDeclaration
    from barc_sim.interfaces.records import Command, VehicleState
    from barc_sim.simulation.log import Log
    from barc_sim.vehicle.plant import Observation

DISTANCE = 4.0  #: [m] of a run
LANES = {'lqr': LaneLQR, 'stanley': Stanley}


def one_of(*values: Any, low: float, high: float) -> st.SearchStrategy[Any]:  # noqa: ANN401
    return st.sampled_from(values) | st.floats(low, high)


def records(kind: Any, **fields: st.SearchStrategy[Any]) -> st.SearchStrategy[Any]:  # noqa: ANN401
    return st.fixed_dictionaries(fields).map(lambda drawn: kind(**drawn))


grades = st.floats(-4.0, 4.0)
roads = st.tuples(grades, grades, st.floats(1.0, 5.0)).map(
    lambda drawn: Road((0.0, drawn[2]), drawn[:2])
)
vehicles = records(
    Vehicle,
    mass=st.floats(1000.0, 3000.0),
    air_drag_coeff=st.floats(0.0, 1.0),
    friction=st.floats(0.0, 300.0),
    l_f=st.floats(1.0, 2.0),
    l_r=st.floats(1.0, 2.0),
)
laterals = records(
    LateralParameters, yaw_inertia=st.floats(3e3, 6e3), dynamic_above=st.floats(2.0, 4.0)
)
actuators = st.just(Actuator()) | records(
    Actuator,
    delay=one_of(0.0, 0.02, 0.04, low=0.0, high=0.1),
    lag=one_of(0.0, low=0.01, high=0.2),
    rate=one_of(inf, low=1.0, high=20.0),
    limit=one_of(inf, low=0.3, high=6.0),
)
noises = st.just(NoiseLevels()) | records(
    NoiseLevels, **{name: st.floats(0.0, 0.02) for name in NoiseLevels._fields}
)
scenarios = st.fixed_dictionaries(
    {
        'road': roads,
        'track': st.sampled_from(['', '', 'oval', 'figure-eight']),
        'vehicle': vehicles,
        'dynamics': st.sampled_from(['kinematic', 'dynamic']),
        'lateral': laterals,
        'integrator': st.sampled_from(['euler', 'rk4']),
        'motor': actuators,
        'servo': actuators,
        'noise': noises,
        'seed': st.integers(0, 1000),
        'sensor_delay': one_of(0.0, 0.02, 0.04, low=0.0, high=0.1),
        'disturbance': one_of(0.0, low=-300.0, high=300.0),
        'ts': st.sampled_from([0.02, 0.01, 1 / 333]),
        'kp': st.floats(5.0, 60.0),
        'ki': st.floats(0.0, 200.0),
        'kd': st.floats(0.0, 0.5),
        'acceleration_limit': st.floats(3.0, 8.0),
        'speed_reference': st.floats(2.0, 8.0),
    }
)


def values_of(fields: dict[str, Any], table: list[ParameterDeclaration]) -> dict[str, Any]:
    """Return the parameters of a node that are the fields of a scenario; 0 stands for infinity."""
    values: dict[str, Any] = {'rate': round(1.0 / fields['ts'])}
    for name, value in fields.items():
        if name in {'motor', 'servo'}:
            delay, lag, rate, limit = (0.0 if each == inf else each for each in value)
            values |= {f'{name}_delay': delay, f'{name}_lag': lag}
            values |= {f'{name}_rate_limit': rate, f'{name}_limit': limit}
        elif name == 'noise':
            values |= {f'noise_{each}': level for each, level in value._asdict().items()}
        elif isinstance(value, tuple):
            values |= value._asdict()
        else:
            values[name] = value
    return {row.name: values.get(row.name, row.default) for row in table}


class Nodes:
    """What simulator and controller are without ROS: each state is answered in lock-step."""

    def __init__(self, fields: dict[str, Any], lane: str) -> None:
        values = values_of(fields, parameters(DISTANCE))
        track = Scenario(track=fields['track']).plant().track
        scenario = Scenario.of_parameters(values, road=fields['road'], track=track)
        options = StepperOptions(realtime_factor=0.0)
        self.stepper = Stepper(scenario, options, self, wall_clock=lambda: 10**18)
        self.control = CruiseControl(
            None,
            lambda table: values_of(fields, table) | {'lane_type': lane},
            fields['acceleration_limit'],
            self._refuse,
            self._refuse,
            track,
        )
        self.seen: list[VehicleState] = []
        self.commands: list[Command] = []

    def drive(self, states: int) -> None:
        """Answer states until the end, this number at most."""
        self.stepper.start()
        while self.stepper.phase is Phase.RUNNING and len(self.commands) < states:
            command = self.control.take_state(self.stepper.stamp, self.seen[-1])
            assert command
            self.commands.append(command)
            assert self.stepper.take_command(command, self.stepper.stamp) is None

    def publish_state(self, _: float, observation: Observation, __: int) -> None:
        """Keep what is measured."""
        self.seen.append(observation.measured)

    def publish_applied(self, *_: object, **__: object) -> None:
        """Drop it."""

    def run_deadlines(self, **_: object) -> None:
        """Have none: lock-step."""

    def defer_decision(self) -> None:
        """Never be called: lock-step."""

    def prepare_start(self, _: str) -> None:
        """Be ready."""

    def finish(self) -> None:
        """End with the phase."""

    def warn(self, sentence: Any, about: str) -> None:  # noqa: ANN401
        """Fail: there is nothing to warn of."""
        raise AssertionError(f'{about}: {sentence()}')

    def _refuse(self, sentence: Any) -> None:  # noqa: ANN401
        raise AssertionError(sentence())


def assert_same(log: Log, nodes: Nodes) -> None:
    nodes.drive(len(log))
    columns = (log.x, log.y, log.psi, log.v_x, log.v_y, log.psi_dot)
    assert [*map(tuple, nodes.seen[: len(log)])] == [*zip(*columns, strict=True)]
    commands = [*zip(log.motor, log.servo, strict=True)]
    assert [*map(tuple, nodes.commands)] == commands


@settings(deadline=None, derandomize=True, max_examples=200)
@given(fields=scenarios, lane=st.sampled_from([*LANES]))
def test_a_drawn_scenario_is_one_run_to_the_last_bit(fields: dict[str, Any], lane: str) -> None:
    law = LANES[lane]() if fields['track'] else None
    scenario = Scenario(**fields, lane=law, distance=DISTANCE, max_duration=4.0)
    try:
        log = simulate(scenario=scenario)
    except UserError as error:
        assert 'too long for the dynamic bicycle' in str(error)  # noqa: PT017
        assume(False)
    assert_same(log, Nodes(fields, lane))
