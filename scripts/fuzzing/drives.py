"""Bags of another robot with gaps, rates, clocks and units as real ones have, for `identify`.

Where only messages are missing, or come at other rates, the estimates must be near the truth, or
have a remark.
"""

from __future__ import annotations

import io
import time
from functools import cache
from typing import TYPE_CHECKING

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

    Kept = NDArray[np.bool_]
    Series = tuple[Floats, Floats]  #: times [s] and values

_FIELDS = {'v_x': '/speed.data', 'motor': '/accel.data'}
_TS = 0.005
_DURATION = 14.0  #: [s]
_NOISE = 0.02  #: [m/s]
_TRUTH = {'drag_per_mass': 0.002, 'friction_per_mass': 0.15, 'motor_delay': 0.12, 'motor_lag': 0.2}
_FAR = 8.0  #: half intervals from the truth
_HONEST = ('gaps', 'lost messages', 'rates')
_KINDS = (*_HONEST, *_HONEST, 'jitter', 'clock', 'values', 'units', 'order')
_VALUES = (float('nan'), float('inf'), 1e308, -1e308, 1e5, 0.0, -3.0)


def clock() -> float:
    """Return the processor time [s] of this process."""
    return time.process_time()


@cache
def original() -> tuple[Log, ...]:
    """Return the drives of the car."""
    motor = Actuator(delay=_TRUTH['motor_delay'], lag=_TRUTH['motor_lag'])
    car = Vehicle(
        air_drag_coeff=2000.0 * _TRUTH['drag_per_mass'],
        friction=2000.0 * _TRUTH['friction_per_mass'],
    )
    return tuple(
        closed_loop(
            Plant(road=Road.flat(), vehicle=car, ts=_TS, motor=motor),
            law,
            distance=1e9,
            max_duration=_DURATION,
        )
        for law in (PRBS(), Steps())
    )


def damaged(chance: Random) -> tuple[str, str, bytes]:
    """Return the suffix of a bag, what is odd about it, and its content."""
    kind = chance.choice(_KINDS)
    log = chance.choice(original())
    random = np.random.default_rng(chance.getrandbits(32))
    period = 1.0 / chance.choice((10.0, 20.0, 33.0, 50.0, 100.0) if kind == 'rates' else (50.0,))
    t = np.arange(0.0, _DURATION - 0.1, period)
    v = np.interp(t, log.t, log.v_x) + random.normal(0.0, _NOISE, len(t))
    at = log.t[:-1]
    motor = log.motor[:-1]
    changes = np.flatnonzero(np.abs(np.diff(motor, prepend=np.inf)) > 0.0)
    at = at[changes]
    motor = motor[changes]
    states = (t, v)
    commands = (at, motor)
    match kind:
        case 'gaps':
            states, commands = _with_gaps(states, commands, chance)
        case 'lost messages':
            share = chance.choice((0.01, 0.1, 0.3, 0.9))
            states = _some(states, random.random(len(t)) > share)
        case 'jitter':
            states = t + random.normal(0.0, chance.choice((1e-3, 0.02, 0.5)), len(t)), v
        case 'clock':
            tick = chance.choice((0.01, 0.1, 1.0, 100.0))
            states = (np.floor(t / tick) * tick, v)
            commands = (np.floor(at / tick) * tick, motor)
        case 'values':
            odd = random.random(len(t)) < chance.choice((0.001, 0.1, 1.0))
            states = t, np.where(odd, chance.choice(_VALUES), v)
            motor = np.where(random.random(len(at)) < 0.05, chance.choice(_VALUES), motor)  # noqa: PLR2004
            commands = at, motor
        case 'units':
            states = t, chance.choice((3.6, 0.001, -1.0, 1000.0, 0.0)) * v
            commands = at, chance.choice((1.0, 100.0, 0.0)) * motor
        case 'order':
            states = random.permutation(t), v
    return f'.{kind.replace(" ", "-")}.mcap', kind, _bag(states, commands)


def _with_gaps(states: Series, commands: Series, chance: Random) -> tuple[Series, Series]:
    """Return both without the times in which the recorder stood still."""
    for _ in range(chance.randint(1, 4)):
        begin = chance.uniform(-0.5, _DURATION)
        end = begin + chance.choice((0.03, 0.1, 0.5, 2.0, 6.0))
        states = _some(states, (states[0] < begin) | (states[0] >= end))
        commands = _some(commands, (commands[0] < begin) | (commands[0] >= end))
    return states, commands


def _some(series: Series, kept: Kept) -> Series:
    return series[0][kept], series[1][kept]


def _bag(states: Series, commands: Series) -> bytes:
    """Return a bag of two topics with numbers."""
    stream = io.BytesIO()
    writer = Writer(stream)
    writer.start('ros2', '')
    schema = writer.register_schema('std_msgs/msg/Float64', 'ros2msg', b'float64 data\n')
    rows = []
    for topic, (times, values) in zip(('/speed', '/accel'), (states, commands), strict=True):
        channel = writer.register_channel(topic, 'cdr', schema)
        rows += [(t, channel, v) for t, v in zip(times.tolist(), values.tolist(), strict=True)]
    for t, channel, value in sorted(rows):
        stamp = int((1000.0 + t) * 1e9)
        writer.add_message(channel, stamp, b'\0\1\0\0' + np.float64(value).tobytes(), stamp)
    writer.finish()  # type: ignore[no-untyped-call]
    return stream.getvalue()


def _identify(path: Path) -> None:
    found = identify(log_of_fields(path, _FIELDS), integrator='rk4')
    kind = path.suffixes[0].lstrip('.').replace('-', ' ')
    if kind not in _HONEST or found.remarks:
        return
    for name, estimate in found.estimates.items():
        if abs(estimate.value - _TRUTH[name]) > _FAR * estimate.interval:
            raise AssertionError(f'{name} is {estimate} without a remark')


def uses(_: Random) -> list[Callable[[Path], object]]:
    """Return what to do with a bag."""
    return [_identify]
