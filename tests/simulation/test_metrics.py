"""The figures of merit of hand-made runs whose answers are known, and the laps of a run."""

from __future__ import annotations

from dataclasses import replace
from math import isnan, nan, sqrt
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from barc_sim.control.speed import PID
from barc_sim.page.protocol import lap_facts, stretch_facts
from barc_sim.simulation.closed_loop import closed_loop
from barc_sim.simulation.log import COLUMNS, Log
from barc_sim.simulation.metrics import (
    Laps,
    LapSettings,
    StretchErrors,
    Summary,
    changes_of,
    lap_settings_of,
    laps_of,
    settings_of,
    summary,
)

if TYPE_CHECKING:
    from collections.abc import Sequence


def run(
    speed: Sequence[float],
    *,
    reference: float | Sequence[float] = 8.0,
    x: Sequence[float] | None = None,
    theta_deg: float | Sequence[float] = 0.0,
    missed: Sequence[bool] | None = None,
) -> Log:
    """Return a log of these true speeds, one state a second and one a metre unless totals."""
    n = len(speed)
    log = Log(
        **{name: np.zeros(n, dtype=np.float64) for name in COLUMNS}  # type: ignore[arg-type]
    )
    return replace(
        log,
        t=np.arange(n, dtype=np.float64),
        x=np.arange(n, dtype=np.float64) if x is None else np.array(x),
        v_x=np.array(speed, dtype=np.float64),
        reference=np.broadcast_to(reference, n).astype(np.float64),
        theta_deg=np.broadcast_to(theta_deg, n).astype(np.float64),
        missed=np.zeros(n, dtype=np.bool_) if missed is None else np.array(missed),
        saturated=np.zeros(n, dtype=np.bool_),
    )


# RMS and maximum error


def test_run_up_is_the_first_10_m_without_their_end() -> None:
    totals = summary(run([0.0, 7.0, 6.0], x=[9.999, 10.0, 11.0]))
    assert totals.max_error == 8.0
    assert totals.max_error_after_run_up == 2.0
    assert totals.rms_error_after_run_up == pytest.approx(sqrt((1.0 + 4.0) / 2.0))


def test_true_speed_and_distance_count_not_the_measured() -> None:
    noisy = replace(
        run([5.0, 12.0], x=[5.0, 15.0]), e_v_x=np.array([-3.0, 4.0]), e_s=np.array([-6.0, 6.0])
    )
    totals = summary(noisy)
    assert totals.max_error == 0.0
    assert totals.max_error_after_run_up == 0.0
    assert (totals.stretches[0].start, totals.stretches[0].end) == (11.0, 9.0)


def test_states_without_a_reference_are_passed_over() -> None:
    totals = summary(run([1.0, 5.0, 12.0], x=[20.0, 21.0, 22.0], reference=[nan, 8.0, 8.0]))
    assert totals.rms_error == totals.rms_error_after_run_up == pytest.approx(sqrt(12.5))
    assert totals.max_error == totals.max_error_after_run_up == 4.0


# Overshoot


@pytest.mark.parametrize(
    ('speed', 'options', 'overshoot'),
    [
        ([0.0, 9.0, 10.0, 8.0], {}, 0.25),
        ([0.0, -9.0, 2.0], {'reference': -8.0}, 0.125),
        ([0.0, 10.0, 8.0, 16.0], {'theta_deg': [0.0, 0.0, 0.0, 5.0]}, 0.25),
    ],
    ids=['share of the reference', 'backwards', 'on the first stretch'],
)
def test_overshoot_is_how_far_the_speed_passes_the_reference(
    speed: list[float], options: dict[str, Any], overshoot: float
) -> None:
    assert summary(run(speed, **options)).overshoot == pytest.approx(overshoot)


# Settling


@pytest.mark.parametrize(
    ('speed', 'options', 'settling_time'),
    [
        ([0.0, 4.0, 8.0, 8.0], {}, 2.0),
        ([0.0, 8.0, 9.0, 8.0], {}, 3.0),
        ([8.0, 8.0, 8.0], {}, 0.0),
        ([0.0, 7.83, 7.85, 8.17, 7.85], {}, 4.0),
        # The band is 2 %, its edges included, in reverse, too.
        ([0.0, 98.0, 102.0], {'reference': 100.0}, 1.0),
        ([0.0, 97.9, 102.1, 102.0], {'reference': 100.0}, 3.0),
        ([0.0, -7.9, -8.1], {'reference': -8.0}, 1.0),
        # Outside at the end.
        ([0.0, 8.0, 7.0], {}, nan),
        ([0.0], {}, nan),
        # The first stretch counts.
        ([0.0, 8.0, 7.0, 8.0], {'theta_deg': [0.0, 0.0, 10.0, 10.0]}, 1.0),
        ([0.0, 7.0, 8.0, 8.0], {'theta_deg': [0.0, 0.0, 10.0, 10.0]}, nan),
    ],
)
def test_settling_time_is_when_the_speed_stays_within_the_band(
    speed: list[float], options: dict[str, Any], settling_time: float
) -> None:
    seconds = summary(run(speed, **options)).settling_time
    assert seconds == pytest.approx(settling_time, nan_ok=True)


# Stretches


def test_stretches_are_the_runs_of_states_on_one_grade() -> None:
    totals = summary(
        run(
            [8.0, 7.0, 5.0, 12.0, 8.0],
            x=[0.0, 1.0, 3.0, 4.5, 6.0],
            theta_deg=[0.0, 0.0, 10.0, 10.0, 0.0],
        )
    )

    assert totals.stretches == (
        StretchErrors(start=0.0, end=1.0, theta_deg=0.0, rms_error=sqrt(0.5), max_error=1.0),
        StretchErrors(start=3.0, end=4.5, theta_deg=10.0, rms_error=sqrt(12.5), max_error=4.0),
        StretchErrors(start=6.0, end=6.0, theta_deg=0.0, rms_error=0.0, max_error=0.0),
    )


def test_states_of_unknown_grade_are_one_stretch() -> None:
    totals = summary(run([8.0, 7.0, 5.0], theta_deg=[0.0, nan, nan]))
    assert [(part.start, part.end) for part in totals.stretches] == [(0.0, 0.0), (1.0, 2.0)]
    assert isnan(totals.stretches[1].theta_deg)


# Runs with little to tell


def test_run_of_one_state_has_all_figures() -> None:
    totals = summary(run([6.0], x=[12.0], missed=[True]))
    assert isnan(totals.settling_time)
    # NaN differs from itself.
    assert replace(totals, settling_time=0.0) == Summary(
        rms_error=2.0,
        max_error=2.0,
        rms_error_after_run_up=2.0,
        max_error_after_run_up=2.0,
        overshoot=0.0,
        settling_time=0.0,
        missed_deadlines=1,
        stretches=(StretchErrors(12.0, 12.0, 0.0, 2.0, 2.0),),
    )


@pytest.mark.parametrize('log', [run([]), run([1.0, 2.0], x=[20.0, 21.0], reference=nan)])
def test_run_without_states_or_reference_has_no_figures_but_its_stretches(log: Log) -> None:
    totals = summary(log)
    figures = replace(totals, missed_deadlines=0, stretches=())
    assert all(isnan(figure) for figure in vars(figures).values() if isinstance(figure, float))
    assert totals.missed_deadlines == 0
    places = [(part.start, part.end, part.theta_deg) for part in totals.stretches]
    assert places == ([(20.0, 21.0, 0.0)] if len(log) else [])
    assert all(isnan(part.rms_error) and isnan(part.max_error) for part in totals.stretches)


# Laps


def joined(*logs: Log, pause: float = 0.0) -> Log:
    """Return a run that begins anew between the logs, after a pause [s]."""
    shifts = np.cumsum([0.0, *(log.t[-1] + 0.02 + pause for log in logs[:-1])])
    parts = [replace(log, t=log.t + shift) for log, shift in zip(logs, shifts, strict=True)]
    columns = [part.columns() for part in parts]
    return Log(**{name: np.concatenate([c[name] for c in columns]) for name in columns[0]})


def test_each_lap_has_the_figures_of_a_run_of_its_own() -> None:
    weak = closed_loop(controller=PID(4.0, 0.0, 0.0, output_min=-8.0, output_max=8.0))
    tuned = closed_loop()
    laps, numbers = laps_of(joined(tuned, weak, tuned))
    assert numbers == [0] * len(tuned) + [1] * len(weak) + [2] * len(tuned)

    facts = lap_facts(laps)
    assert facts['count'] == 3

    for name, log, number in (('current', tuned, 2), ('last', weak, 1), ('best', tuned, 0)):
        totals = summary(log)
        assert facts[name]['number'] == number
        assert facts[name]['rms'] == pytest.approx(totals.rms_error_after_run_up)
        assert facts[name]['maximum'] == pytest.approx(totals.max_error_after_run_up)
        assert facts[name]['overshoot'] == pytest.approx(totals.overshoot)
    assert [stretch['theta_deg'] for stretch in stretch_facts(laps.current)][:2] == [0.0, 10.0]


def test_fast_car_without_a_reset_drives_one_lap() -> None:
    laps = Laps()
    numbers = {laps.add(0.02 * k, 2.0 * k, 0.0, 100.0, 8.0, 0.0) for k in range(100)}
    assert numbers == {0}


def test_reset_after_a_long_pause_begins_a_lap() -> None:
    laps = Laps()
    assert laps.add(0.0, 0.0, 0.0, 0.0, 8.0, 0.0) == 0
    assert laps.add(4.0, 32.0, 0.0, 8.0, 8.0, 10.0) == 0
    assert laps.add(64.0, 0.0, 0.0, 0.0, 8.0, 0.0) == 1


def test_the_last_lap_can_be_the_best_once_the_run_has_ended() -> None:
    weak = closed_loop(controller=PID(4.0, 0.0, 0.0, output_min=-8.0, output_max=8.0))
    tuned = closed_loop()
    laps, _ = laps_of(joined(weak, tuned))
    assert laps.best == laps.current

    cut_short = tuned.map(lambda column: column[:600])
    laps, _ = laps_of(joined(weak, cut_short))
    assert laps.best == laps.finished[0]

    live = Laps()
    columns = (weak.t, weak.distance, weak.across, weak.speed, weak.reference, weak.theta_deg)
    for row in zip(*columns, strict=True):
        live.add(*row)
    assert live.best is None

    live.end()
    assert live.best is None  # of one lap


def test_settings_that_change_at_once_are_left_out() -> None:
    """A preset changes one gain after the other, and is chosen before the next lap begins."""
    settings = LapSettings()
    first, second = {'kp': 2.0, 'ki': 0.0}, {'kp': 4.0, 'ki': 8.0}
    for t in (0.0, 10.0):
        settings.add(0, t, first)
    settings.add(0, 10.02, {'kp': 4.0, 'ki': 0.0})
    settings.add(0, 10.04, second)
    for t in (10.06, 20.0):
        settings.add(1, t, second)

    assert [settings.text(lap) for lap in range(3)] == ['kp 2, ki 0', 'kp 4, ki 8', '']


def test_settings_of_a_lap_are_in_their_order() -> None:
    settings = LapSettings()
    for t, kp in (
        (0.0, 1.0),
        (1.0, 1.0),
        (2.0, 2.0),
        (3.0, 2.0),
        (3.02, 9.0),
        (3.04, 2.0),
        (4.0, 2.0),
    ):
        settings.add(0, t, {'kp': kp, 'ki': 0.5})
    assert settings.text(0) == 'kp 1 → 2, ki 0.5'

    for t, kp in ((5.0, 3.0), (6.0, 3.0), (7.0, 4.0), (8.0, 4.0)):
        settings.add(0, t, {'kp': kp, 'ki': 0.5})
    assert settings.text(0) == 'kp 1 → … → 4, ki 0.5'


def test_a_lap_of_one_state_has_its_settings() -> None:
    settings = LapSettings()
    settings.add(0, 0.0, {'kp': 1.0})
    assert settings.text(0) == 'kp 1'


def test_gains_are_shown_and_other_parameters_where_they_were_changed() -> None:
    log = closed_loop(distance=5.0)
    n = len(log)
    late = np.where(np.arange(n) < n // 2, np.nan, 3.0)
    parameters = {
        'controller.kp': np.full(n, 2.0),
        'controller.ki': late,
        'controller.speed_reference': np.full(n, 8.0),
        'vehicle_simulator.noise_v_x': np.where(np.arange(n) < n // 2, 0.0, 0.1),
        'controller.lane.k': np.full(n, 1.0),
    }
    with_parameters = replace(log, parameters=parameters)
    assert [*settings_of(with_parameters)] == ['kp', 'ki', 'noise_v_x']
    assert changes_of(with_parameters) == {'noise_v_x': 'noise_v_x 0 → 0.1'}
    assert lap_settings_of(with_parameters, [0] * n).text(0) == 'kp 2, ki 3, noise_v_x 0 → 0.1'

    many = {f'controller.k_{k}': np.full(n, 1.0) for k in range(5)}
    many['controller.k_1'] = np.linspace(0.0, 1.0, n)
    assert [*settings_of(replace(log, parameters=many))] == ['k_1']
    assert changes_of(log) == {}
