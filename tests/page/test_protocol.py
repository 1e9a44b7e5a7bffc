"""What a page may send, that nothing else gets through, and what a page is sent of a run."""

from __future__ import annotations

import json
import math
from importlib import resources
from typing import TYPE_CHECKING, Any, ClassVar

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from barc_sim.control.cruise_control import CruiseControl
from barc_sim.control.driver import DriverInput
from barc_sim.control.lane import LaneLQR
from barc_sim.control.pilots import Pilot
from barc_sim.control.speed import LQR, PID, Gain, speed_controller
from barc_sim.errors import UserError
from barc_sim.interfaces.records import Command
from barc_sim.page.protocol import (
    CAR,
    SHARED_SLIDERS,
    Pause,
    Press,
    RequestError,
    RunFacts,
    Tune,
    facts,
    parse,
)
from barc_sim.simulation.closed_loop import closed_loop, simulate
from barc_sim.simulation.metrics import summary
from barc_sim.vehicle.plant import Actuator, Plant
from barc_sim.vehicle.road import Road
from barc_sim.vehicle.track import Track

if TYPE_CHECKING:
    from barc_sim.control.situation import Situation
    from barc_sim.interfaces.parameters import ParameterDeclaration

MALFORMED = [
    '',
    '{',
    'null',
    '[]',
    '{}',
    '{"type":"fly"}',
    '{"type":["drive"],"forward":0,"turn":0,"brake":0}',
    '{"type":"drive"}',
    '{"type":"drive","forward":1}',
    '{"type":"drive","forward":1.01,"turn":0,"brake":0}',
    '{"type":"drive","forward":0,"turn":-1.01,"brake":0}',
    '{"type":"drive","forward":NaN,"turn":0,"brake":0}',
    '{"type":"drive","forward":1e999,"turn":0,"brake":0}',
    '{"type":"drive","forward":"1","turn":0,"brake":0}',
    '{"type":"drive","forward":true,"turn":0,"brake":0}',
    '{"type":"drive","forward":0,"turn":0,"brake":0,"more":0}',
    '{"type":"tune","name":["kp"],"value":1}',
    '{"type":"tune","name":"kp","value":1e999}',
    '{"type":"tune","name":"kp","value":' + '9' * 400 + '}',
    '{"type":"tune","name":"kp"}',
    '{"type":"pause","on":1}',
    '{"type":"pause"}',
    '{"type":"reset","hard":true}',
    '[' * 100_000,
    b'{"type":"reset"}',
    '{"type":"drive","forward":0,"turn":0,"brake":-1}',
    '{"type":"drive","forward":0,"turn":0,"brake":2}',
]


@pytest.mark.parametrize(
    ('message', 'request_'),
    [
        ('{"type":"drive","forward":1,"turn":-0.5,"brake":0}', DriverInput(1.0, -0.5)),
        ('{"type":"drive","forward":0,"turn":0,"brake":1}', DriverInput(brake=1.0)),
        ('{"type":"tune","name":"kp","value":3}', Tune('kp', 3.0)),
        ('{"type":"tune","name":"motor_delay","value":0.1}', Tune('motor_delay', 0.1)),
        ('{"type":"tune","name":"kp","value":1e10}', Tune('kp', 1e10)),  # a node's limits refuse it
        ('{"type":"finish"}', Press('finish')),
        ('{"type":"tune","name":"speed_reference","value":-2.5}', Tune('speed_reference', -2.5)),
        ('{"type":"reset"}', Press('reset')),
        ('{"type":"pause","on":false}', Pause(on=False)),
    ],
)
def test_each_request_of_the_page_is_decoded(message: str, request_: object) -> None:
    request = parse(message)
    assert request == request_
    assert type(request) is type(request_)


@pytest.mark.parametrize('message', MALFORMED, ids=lambda message: repr(message)[:40])
def test_a_request_that_no_page_sends_is_refused(message: str | bytes) -> None:
    with pytest.raises(RequestError):
        parse(message)


_JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8),
    lambda inner: (
        st.lists(inner, max_size=3)
        | st.dictionaries(
            st.sampled_from(['type', 'forward', 'turn', 'name', 'value', 'on']), inner, max_size=4
        )
    ),
    max_leaves=6,
)


@settings(max_examples=50)
@given(_JSON.map(json.dumps) | st.text() | st.binary())
def test_any_message_is_a_request_within_limits_or_refused(message: str | bytes) -> None:
    try:
        request = parse(message)
    except RequestError:
        return

    if isinstance(request, DriverInput):
        assert all(-1.0 <= share <= 1.0 for share in request)
    elif isinstance(request, Tune):
        assert math.isfinite(request.value)
    else:
        assert isinstance(request, (Press, Pause))


def run_of(law: object, lane: object = None, track: Track | None = None) -> RunFacts:
    """Return the facts of a run with these laws, and 0.1 s of delay."""

    def declare(parameters: list[ParameterDeclaration]) -> dict[str, Any]:
        return {each.name: each.default for each in parameters}

    def never(_: object) -> None:
        """Take no warning."""

    control = CruiseControl(law, declare, 8.0, never, never, track, lane)
    car = {'l_f': 1.25, 'l_r': 1.75, 'motor_delay': 0.1}
    return RunFacts(lambda: car, control, Road.lab(), track)


def test_road_and_car_are_among_the_facts() -> None:
    page_facts = facts('acc', run_of(PID()))
    assert page_facts['road']['starts'][:3] == [0.0, 20.0, 40.0]
    assert page_facts['axles'] == [-1.75, 1.25]


def test_sliders_and_terms_follow_from_the_controllers_declaration() -> None:
    page_facts = facts('acc', run_of(LQR(observer_gain=0.5)))
    assert page_facts['terms'] == ['feedback', 'compensation']
    assert [*page_facts['sliders']] == [*LQR.gains, *SHARED_SLIDERS, *CAR]
    assert page_facts['sliders']['observer_gain'] == {
        'label': 'Gain of the disturbance observer, observer_gain',
        'short': 'observer gain',
        'unit': '',
        'max': 1.0,
        'limits': (0.0, 1.0),
        'expected': 'a number from 0 to 1',
        'node': 'controller',
    }
    assert facts('acc', run_of(PID()))['sliders']['kp']['label'] == 'Proportional gain, kp [1/s]'
    assert page_facts['sliders']['motor_limit']['label'] == 'Limit of the motor, 0: none [m/s²]'
    assert page_facts['sliders']['speed_reference']['unit'] == 'm/s'

    values = {'observer_gain': 0.5, 'acceleration_limit': 8.0, 'motor_delay': 0.1}
    assert values.items() <= page_facts['tuning'].items()
    assert page_facts['controller_type'] == 'lqr'


@pytest.mark.parametrize(
    ('name', 'value', 'argument'),
    [
        ('kp', 2e6, 'kp'),
        ('kd', -1e10, 'kd'),
        ('speed_reference', 101.0, 'speed_reference'),
        ('speed_reference', -5.0, 'speed_reference'),
        ('acceleration_limit', 0.0, 'acceleration_limit'),
        ('noise_v_x', -0.1, 'noise'),
        ('motor_delay', -0.1, 'delay'),
        ('sensor_delay', -0.1, 'sensor_delay'),
    ],
)
def test_a_slider_refuses_a_value_with_the_sentence_of_python(
    name: str, value: float, argument: str
) -> None:
    run = run_of(PID())
    run = run._replace(simulator=lambda: {'distance': 180.0})
    with pytest.raises(UserError) as refusal:
        run.check(name, value)
    with pytest.raises(UserError) as python:
        simulate(**{argument: value})
    assert str(refusal.value).replace(name, argument) == str(python.value)


def test_a_slider_takes_its_limits_and_a_car_without_an_end_goes_backwards() -> None:
    run = run_of(PID())
    for name, (low, high) in ((name, run.limits(name)) for name in run.sliders):
        run.check(name, low)
        run.check(name, high)
    run.check('speed_reference', -5.0)
    ahead = run._replace(simulator=lambda: {'distance': 180.0})
    assert ahead.limits('speed_reference') == (0.0, 100.0)

    lap = run_of(PID(), LaneLQR(), Track.named('L'))
    lap.check('speed_reference', -5.0)
    lap = lap._replace(simulator=lambda: {'laps': 3})
    with pytest.raises(UserError, match='leads away from the distance'):
        lap.check('speed_reference', -5.0)
    with pytest.raises(UserError, match='mass: this page has no such slider'):
        run.check('mass', 1.0)


@pytest.mark.parametrize(
    'run', [run_of(PID()), run_of(LQR()), run_of(PID(), LaneLQR(), Track.named('L'))]
)
def test_defaults_and_presets_are_within_the_limits(run: RunFacts) -> None:
    page_facts = facts('acc', run)
    for values in (page_facts['tuning'], *page_facts['presets'].values()):
        for name, value in values.items():
            run.check(name, value)


def test_presets_set_known_parameters_and_the_windup_alone_has_a_limit_of_the_motor() -> None:
    page_facts = facts('acc', RunFacts())
    presets = page_facts['presets']
    assert {name for values in presets.values() for name in values} <= page_facts['sliders'].keys()
    assert [name for name, values in presets.items() if values['motor_limit']] == ['Windup']

    windup = presets['Windup']
    limited = {**windup, 'acceleration_limit': windup['motor_limit']}
    overshoots = []
    for values in (windup, limited):
        limit = values['acceleration_limit']
        controller = speed_controller(values['kp'], values['ki'], values['kd'], limit)
        log = closed_loop(Plant(motor=Actuator(limit=values['motor_limit'])), controller)
        overshoots.append(summary(log).overshoot)
    assert overshoots[0] > 0.5
    assert overshoots[1] < 0.1


def test_the_sliders_can_halve_the_error_of_the_default_gains_as_the_page_claims() -> None:
    page_facts = facts('acc', RunFacts())
    error = summary(simulate()).rms_error_after_run_up
    page = (resources.files('barc_sim.page') / 'web' / 'tuning.js').read_text('utf-8')
    assert f'{error:.3f} m/s: kp and ki can halve it' in page
    better = {'kp': 70.0, 'ki': 400.0, 'kd': 0.0}
    assert all(value <= page_facts['sliders'][name]['max'] for name, value in better.items())
    assert summary(simulate(**better)).rms_error_after_run_up < 0.5 * error


def test_a_drive_of_commands_alone_has_no_sliders() -> None:
    """It holds no speed, and its car is what a student is to identify."""

    class Commands(Pilot):
        @property
        def follows_reference(self) -> bool:
            return False

        def command(self, situation: Situation) -> Command:
            return Command(situation.t, 0.0)

    page_facts = facts('acc', run_of(Commands()))
    assert (page_facts['sliders'], page_facts['tuning'], page_facts['presets']) == ({}, {}, {})


class OwnLane:
    """A law of a user's, that declares its gain."""

    gains: ClassVar = {'k_e_y': Gain(0.5, '-', 'gain of e_y', 1.0)}
    k_e_y = 0.5

    def steer_calculate(self, e_y: float, *_: object) -> float:
        """Steer."""
        return -self.k_e_y * e_y


@pytest.mark.parametrize(
    ('law', 'gains', 'name'),
    [(LaneLQR(), ['q_e_y', 'q_e_psi', 'preview'], 'lqr'), (OwnLane(), ['k_e_y'], '')],
)
def test_on_a_track_the_sliders_are_those_of_the_steering(
    law: object, gains: list[str], name: str
) -> None:
    page_facts = facts('acc', run_of(PID(), law, Track.named('L')))
    assert [*page_facts['sliders']] == [*(f'lane.{gain}' for gain in gains), 'speed_reference']
    assert page_facts['tuning'].keys() == page_facts['sliders'].keys()
    assert (page_facts['mode'], page_facts['run']['lane']) == ('track', name)
    assert page_facts['sliders'][f'lane.{gains[0]}']['short'] == gains[0]


def test_the_command_to_copy_has_the_users_code() -> None:
    assert facts('acc', RunFacts(options={'lab': 'mine'}))['run'] == {'lab': 'mine'}
