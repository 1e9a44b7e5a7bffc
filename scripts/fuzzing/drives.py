"""Bags of another robot with gaps, rates, clocks and units as real ones have, for `identify`.

Where only messages are missing, or come at other rates, the estimates must be near the truth, or
have a remark.
"""

from __future__ import annotations

import io
import time
from functools import cache
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from mcap.writer import Writer

from barc_sim.bags.convert import log_of_fields
from barc_sim.control.excitation import PRBS, Steps
from barc_sim.simulation.closed_loop import closed_loop
from barc_sim.tuning.identification import identify
from barc_sim.vehicle.bike_model import Vehicle
from barc_sim.vehicle.plant import Actuator, Plant
from barc_sim.vehicle.road import Road

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path
    from random import Random

    from numpy.typing import NDArray

    from barc_sim.simulation.log import Floats, Log


_FIELDS = {'v_x': '/speed.data', 'motor': '/accel.data'}
_TS = 0.005
_DURATION = 14.0  #: [s]
_NOISE = 0.02  #: [m/s]
_TRUTH = {'drag_per_mass': 0.002, 'friction_per_mass': 0.15, 'motor_delay': 0.12, 'motor_lag': 0.2}
_MAX_ERROR = 8.0  #: half intervals from the truth
#: The values of these bags are right.
_HONEST = ('gaps', 'lost messages', 'rates')
_KINDS = (*_HONEST, *_HONEST, 'jitter', 'clock', 'values', 'units', 'order')
_VALUES = (float('nan'), float('inf'), 1e308, -1e308, 1e5, 0.0, -3.0)


def clock() -> float:
    """Return the processor time [s] of this process."""
    return time.process_time()


class _Series(NamedTuple):
    """Numbers that one topic carries."""

    times: Floats  #: [s]
    values: Floats

    def where(self, mask: NDArray[np.bool_]) -> _Series:
        return _Series(self.times[mask], self.values[mask])

    def scaled(self, factor: float) -> _Series:
        return _Series(self.times, factor * self.values)

    def with_clock(self, tick: float) -> _Series:
        """Return it with the times of a clock that moves in ticks [s]."""
        return _Series(np.floor(self.times / tick) * tick, self.values)


@cache
def original() -> tuple[Log, ...]:
    """Return the drives of the car."""
    motor = Actuator(delay=_TRUTH['motor_delay'], lag=_TRUTH['motor_lag'])
    car = Vehicle(
        air_drag_coeff=2000.0 * _TRUTH['drag_per_mass'],
        friction=2000.0 * _TRUTH['friction_per_mass'],
    )
    plants = [Plant(road=Road.flat(), vehicle=car, ts=_TS, motor=motor) for _ in range(2)]
    return (
        closed_loop(plants[0], PRBS(), distance=1e9, max_duration=_DURATION),
        closed_loop(plants[1], Steps(), distance=1e9, max_duration=_DURATION),
    )


def damaged_file(chance: Random) -> tuple[str, str, bytes]:
    """Return the suffix of a bag, what is odd about it, and its content."""
    kind = chance.choice(_KINDS)
    log = chance.choice(original())
    random = np.random.default_rng(chance.getrandbits(32))

    period = 1.0 / chance.choice((10.0, 20.0, 33.0, 50.0, 100.0) if kind == 'rates' else (50.0,))
    t = np.arange(0.0, _DURATION - 0.1, period)
    v = np.interp(t, log.t, log.v_x) + random.normal(0.0, _NOISE, len(t))
    states = _Series(t, v)
    commands = _changes(_Series(log.t[:-1], log.motor[:-1]))

    states, commands = _damage(kind, states, commands, chance, random)
    return f'.{kind.replace(" ", "-")}.mcap', kind, _bag(states, commands)


def _changes(series: _Series) -> _Series:
    """Return the first value, and each one that differs from the value before."""
    steps = np.diff(series.values, prepend=np.inf)
    return series.where(np.abs(steps) > 0.0)


def _damage(
    kind: str, states: _Series, commands: _Series, chance: Random, random: np.random.Generator
) -> tuple[_Series, _Series]:
    count = len(states.times)
    match kind:
        case 'gaps':
            states, commands = _with_gaps(states, commands, chance)
        case 'lost messages':
            share = chance.choice((0.01, 0.1, 0.3, 0.9))
            states = states.where(random.random(count) > share)
        case 'jitter':
            jitter = random.normal(0.0, chance.choice((1e-3, 0.02, 0.5)), count)
            states = _Series(states.times + jitter, states.values)
        case 'clock':
            tick = chance.choice((0.01, 0.1, 1.0, 100.0))
            states = states.with_clock(tick)
            commands = commands.with_clock(tick)
        case 'values':
            states = _with_odd_values(states, chance.choice((0.001, 0.1, 1.0)), chance, random)
            commands = _with_odd_values(commands, 0.05, chance, random)
        case 'units':
            states = states.scaled(chance.choice((3.6, 0.001, -1.0, 1000.0, 0.0)))
            commands = commands.scaled(chance.choice((1.0, 100.0, 0.0)))
        case 'order':
            states = _Series(random.permutation(states.times), states.values)
    return states, commands


def _with_gaps(states: _Series, commands: _Series, chance: Random) -> tuple[_Series, _Series]:
    """Return both without the times in which the recorder stood still."""
    for _ in range(chance.randint(1, 4)):
        begin = chance.uniform(-0.5, _DURATION)
        end = begin + chance.choice((0.03, 0.1, 0.5, 2.0, 6.0))
        states = states.where((states.times < begin) | (states.times >= end))
        commands = commands.where((commands.times < begin) | (commands.times >= end))
    return states, commands


def _with_odd_values(
    series: _Series, share: float, chance: Random, random: np.random.Generator
) -> _Series:
    """Return it with the same odd value in a share of the places."""
    is_odd = random.random(len(series.times)) < share
    return _Series(series.times, np.where(is_odd, chance.choice(_VALUES), series.values))


def _bag(states: _Series, commands: _Series) -> bytes:
    """Return a bag of two topics with numbers."""
    stream = io.BytesIO()
    writer = Writer(stream)
    writer.start('ros2', '')
    schema = writer.register_schema('std_msgs/msg/Float64', 'ros2msg', b'float64 data\n')

    rows = []
    for topic, series in (('/speed', states), ('/accel', commands)):
        channel = writer.register_channel(topic, 'cdr', schema)
        for t, value in zip(series.times.tolist(), series.values.tolist(), strict=True):
            rows.append((t, channel, value))

    for t, channel, value in sorted(rows):
        stamp = int((1000.0 + t) * 1e9)
        writer.add_message(channel, stamp, b'\0\1\0\0' + np.float64(value).tobytes(), stamp)
    writer.finish()  # type: ignore[no-untyped-call]
    return stream.getvalue()


def _identify(path: Path) -> None:
    result = identify(log_of_fields(path, _FIELDS), integrator='rk4')
    kind = path.suffixes[0].lstrip('.').replace('-', ' ')
    if kind not in _HONEST or result.remarks:
        return
    for name, estimate in result.estimates.items():
        if abs(estimate.value - _TRUTH[name]) > _MAX_ERROR * estimate.interval:
            raise AssertionError(f'{name} is {estimate} without a remark')


def uses(_: Random) -> list[Callable[[Path], object]]:
    """Return what to do with a bag."""
    return [_identify]
