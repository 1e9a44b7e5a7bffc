"""Samples of a car's topics joined to a log."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np

from barc_sim.bags.reader import TOPICS, Samples
from barc_sim.bags.reader import join as join_samples
from barc_sim.simulation.log import STATE, Log

PERIOD = 20_000_000


class Sample(NamedTuple):
    """A message: its stamp and publication [ns], and its fields."""

    stamp: int
    published: int
    values: tuple[float, ...]


def join(messages: dict[str, list[Sample]]) -> Log:
    """Return the log of the messages of a car, by topic."""
    made = {topic: Samples(Path('bag'), len(TOPICS[topic])) for topic in messages}
    for topic, samples in messages.items():
        for sample in samples:
            made[topic].add(*sample, {})
    return join_samples(made)


def state(k: int) -> Sample:
    """Return state `k`: its values are `k`, and it is published at `100 k`."""
    return Sample(1 + k * PERIOD, 100 * k, (float(k),) * len(TOPICS[STATE]))


def command(k: int, published: int, motor: float = 0.0) -> Sample:
    """Return a command that answers state `k`."""
    return Sample(1 + k * PERIOD, published, (motor, 0.0))


def unstamped(published: int, motor: float) -> Sample:
    return Sample(0, published, (motor, 0.0))


def test_rows_are_in_the_order_of_the_stamps_whatever_the_order_of_the_file() -> None:
    log = join({STATE: [state(2), state(0), state(1)]})
    assert log.x.tolist() == [0.0, 1.0, 2.0]
    assert log.t.tolist() == [0.0, 0.02, 0.04]


def test_every_topic_finds_its_state_by_the_stamp() -> None:
    samples = {STATE: [state(k) for k in range(4)]}
    for topic, fields in TOPICS.items():
        if topic != STATE:
            samples[topic] = [
                Sample(1 + k * PERIOD, 100 * k + 1, (10.0 * k,) * len(fields)) for k in (3, 1)
            ]
    log = join(samples)
    for values in (log.e_s, log.e_psi_dot, log.motor, log.servo, log.theta_deg, log.elevation):
        np.testing.assert_array_equal(values, [np.nan, 10.0, np.nan, 30.0])
    for values in (log.friction, log.gravity, log.reference, log.derivative):
        np.testing.assert_array_equal(values, [np.nan, 10.0, np.nan, 30.0])


def test_quantities_the_run_did_not_have_are_nan() -> None:
    log = join({STATE: [state(0), state(1)]})
    assert np.isnan(log.motor).all()
    assert np.isnan(log.reference).all()
    assert np.isnan(log.theta_deg).all()
    assert not log.saturated.any()


def test_saturated_is_what_the_controller_published() -> None:
    said = [Sample(1 + k * PERIOD, 100 * k, (8.0, 1.0, 0.0, 0.0, k == 1)) for k in range(2)]
    log = join({STATE: [state(0), state(1)], 'pid_state': said})
    assert log.saturated.tolist() == [False, True]
    assert log.reference.tolist() == [8.0, 8.0]


def test_a_command_is_missed_unless_published_before_the_next_state() -> None:
    states = [state(k) for k in range(4)]
    commands = [command(0, 99), command(1, 200, motor=3.0), command(3, 301)]
    log = join({STATE: states, 'ecu': commands})
    assert log.missed.tolist() == [False, True, True, False]
    assert log.motor[1] == 3.0


def test_the_last_state_is_missed_only_if_nothing_answers_it() -> None:
    states = [state(0), state(1)]
    assert join({STATE: states, 'ecu': [command(0, 50), command(1, 10**9)]}).missed.sum() == 0
    assert join({STATE: states, 'ecu': [command(0, 50)]}).missed.tolist() == [False, True]


def test_of_several_answers_the_first_published_counts() -> None:
    commands = [command(0, 60, motor=2.0), command(0, 50, motor=1.0)]
    log = join({STATE: [state(0)], 'ecu': commands})
    assert log.motor.tolist() == [1.0]


def test_a_command_without_a_stamp_holds_and_nothing_is_missed() -> None:
    states = [state(k) for k in range(4)]
    log = join({STATE: states, 'ecu': [unstamped(150, 1.0), unstamped(350, 2.0)]})
    np.testing.assert_array_equal(log.motor, [np.nan, 1.0, 1.0, 2.0])
    assert log.missed.tolist() == [True, False, False, False]
