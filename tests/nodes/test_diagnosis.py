"""Diagnoses of a run's health."""

from __future__ import annotations

from typing import NamedTuple

import pytest

pytest.importorskip('rclpy')

from diagnostic_msgs.msg import DiagnosticStatus

from barc_sim.nodes.diagnosis import Facts, diagnose
from barc_sim.vehicle.sensor import NoiseLevels

WELL = Facts(0, 0, False, 1.0, NoiseLevels(), 100, 0)
REAL = (1.0, 0.01)  # factor, and age of the command [s]


class Diagnosis(NamedTuple):
    """What a status says."""

    level: bytes
    message: str
    values: dict[str, str]


def named(found: list[DiagnosticStatus]) -> dict[str, Diagnosis]:
    return {
        each.name: Diagnosis(
            each.level, each.message, {value.key: value.value for value in each.values}
        )
        for each in found
    }


def test_run_that_is_well_is_ok_in_everything() -> None:
    found = diagnose(WELL, WELL, *REAL)
    assert [diagnosis.name for diagnosis in found] == ['timing', 'command', 'noise', 'bag']
    assert {diagnosis.level for diagnosis in found} == {DiagnosticStatus.OK}


def test_figures_are_among_the_values() -> None:
    found = named(diagnose(WELL, WELL, *REAL))
    assert found['timing'].values == {
        'missed deadlines': '0',
        'slipped periods': '0',
        'real-time factor': '1.000',
    }
    assert found['command'].values == {'age [s]': '0.010000'}
    assert found['bag'].values == {'recorded messages': '100', 'lost messages': '0'}


@pytest.mark.parametrize(
    ('facts', 'measured', 'message'),
    [
        (
            WELL._replace(missed=2),
            REAL,
            '2 commands missed their deadline',
        ),
        (
            WELL._replace(slipped=3),
            REAL,
            'simulated time has fallen behind by 3 periods',
        ),
        (
            WELL._replace(requested_factor=5.0),
            (3.0, None),
            'simulated time runs at 3.00, not at 5',
        ),
    ],
)
def test_late_run_is_a_warning(
    facts: Facts, measured: tuple[float, float | None], message: str
) -> None:
    timing = named(diagnose(facts, WELL, *measured))['timing']
    assert (timing.level, timing.message) == (DiagnosticStatus.WARN, message)


def test_stamps_behind_the_wall_clock_are_a_warning_until_a_reset() -> None:
    behind = WELL._replace(stamp_lag=6.1)
    timing = named(diagnose(behind, behind, *REAL))['timing']
    assert timing.level == DiagnosticStatus.WARN
    assert timing.message.startswith('stamps are 6.1 s behind the wall clock')
    assert timing.values['behind the wall clock [s]'] == '6.100'
    aligned = WELL._replace(stamp_lag=0.004)
    assert named(diagnose(aligned, aligned, *REAL))['timing'].level == DiagnosticStatus.OK


def test_deadline_that_was_missed_long_ago_is_only_counted() -> None:
    late = WELL._replace(missed=2, slipped=1)
    timing = named(diagnose(late, late, *REAL))['timing']
    assert (timing.level, timing.values['missed deadlines']) == (DiagnosticStatus.OK, '2')


def test_time_that_stands_still_on_purpose_is_ok() -> None:
    timing = named(diagnose(WELL._replace(paused=True), WELL, 0.0))['timing']
    assert (timing.level, timing.message) == (DiagnosticStatus.OK, 'paused')


def test_as_fast_as_it_goes_is_never_too_slow() -> None:
    timing = named(diagnose(WELL._replace(requested_factor=0.0), WELL, 0.1))['timing']
    assert timing.level == DiagnosticStatus.OK


def test_noisy_signals_are_named() -> None:
    facts = WELL._replace(noise=NoiseLevels(epsi=0.01, v_x=0.1))
    noise = named(diagnose(facts, WELL, *REAL))['noise']
    assert noise.message == 'of epsi, v_x'
    assert (noise.values['epsi'], noise.values['s']) == ('0.01', '0')


def test_loss_is_a_warning_and_a_bag_that_cannot_be_written_an_error() -> None:
    lossy = named(diagnose(WELL._replace(lost=7), WELL, *REAL))['bag']
    assert (lossy.level, lossy.message) == (DiagnosticStatus.WARN, '7 messages are lost')
    broken = named(diagnose(WELL._replace(lost=7, failure='disk full'), WELL, *REAL))['bag']
    assert (broken.level, broken.message) == (DiagnosticStatus.ERROR, 'disk full')


def test_unknown_facts_have_no_diagnosis() -> None:
    found = named(diagnose(Facts(), Facts()))
    assert found == {'timing': Diagnosis(DiagnosticStatus.OK, 'in time', {})}


def test_nodes_that_command_together_are_named() -> None:
    command = named(diagnose(WELL._replace(rivals=['/a', '/b']), WELL, *REAL))['command']
    assert (command.level, command.message) == (
        DiagnosticStatus.WARN,
        '/a and /b drive together: end one',
    )
