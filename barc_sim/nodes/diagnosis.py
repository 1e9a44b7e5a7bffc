"""Diagnoses of a run's health."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from diagnostic_msgs.msg import DiagnosticStatus, KeyValue

from barc_sim.simulation.timing import TOLERATED

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from barc_sim.vehicle.sensor import NoiseLevels

_OK, _WARN, _ERROR = DiagnosticStatus.OK, DiagnosticStatus.WARN, DiagnosticStatus.ERROR
#: Share of the requested real-time factor below which a run is slow.
_SLOW = 0.9


class Facts(NamedTuple):
    """Facts of a run that no topic carries; None where unknown."""

    missed: int | None = None  #: commands that missed their deadline
    slipped: int | None = None  #: periods by which time has fallen behind the wall clock
    paused: bool | None = None
    requested_factor: float | None = None  #: simulated seconds per second; 0: as fast as possible
    noise: NoiseLevels | None = None  #: standard deviations
    recorded: int | None = None  #: messages in the bag
    lost: int | None = None  #: messages lost
    failure: str | None = None  #: why the bag could not be written
    rivals: Sequence[str] = ()  #: the nodes that command, where there are several
    stamp_lag: float | None = None  #: [s] by which stamps in real time are behind the wall clock


def diagnose(
    facts: Facts, before: Facts, factor: float | None = None, age: float | None = None
) -> list[DiagnosticStatus]:
    """Return the diagnoses; `before` has the facts of the last call.

    `factor` is simulated seconds per second since then, and `age` [s] that of the latest command.
    """
    found = [_timing(facts, before, factor)]
    if age is not None:
        level, message = _OK, f'{age:.3f} s old'
        if facts.rivals:
            level, message = (
                _WARN,
                f'{" and ".join(facts.rivals)} drive together: end one',
            )
        found.append(_status('command', level, message, {'age [s]': f'{age:.6f}'}))
    if facts.noise is not None:
        noisy = ', '.join(name for name, value in facts.noise._asdict().items() if value)
        values = {name: f'{value:g}' for name, value in facts.noise._asdict().items()}
        found.append(_status('noise', _OK, f'of {noisy}' if noisy else 'none', values))
    if facts.recorded is not None:
        found.append(_recording(facts))
    return found


def _timing(facts: Facts, before: Facts, factor: float | None) -> DiagnosticStatus:
    missed = (facts.missed or 0) - (before.missed or 0)
    slipped = (facts.slipped or 0) - (before.slipped or 0)
    requested = facts.requested_factor or 0.0
    level, message = _WARN, 'in time'
    if facts.paused:
        level, message = _OK, 'paused'
    elif missed > 0:
        message = f'{missed} commands missed their deadline'
    elif slipped > 0:
        message = f'simulated time has fallen behind by {slipped} periods'
    elif factor is not None and factor < _SLOW * requested:
        message = f'simulated time runs at {factor:.2f}, not at {requested:g}'
    elif (facts.stamp_lag or 0.0) > TOLERATED:
        message = (
            f'stamps are {facts.stamp_lag:.1f} s behind the wall clock: use_sim_time, or reset'
        )
    else:
        level = _OK
    values = {
        'missed deadlines': facts.missed,
        'slipped periods': facts.slipped,
        'real-time factor': None if factor is None else f'{factor:.3f}',
        'behind the wall clock [s]': None if facts.stamp_lag is None else f'{facts.stamp_lag:.3f}',
    }
    return _status('timing', level, message, values)


def _recording(facts: Facts) -> DiagnosticStatus:
    level, message = _OK, 'nothing is lost'
    if facts.failure:
        level, message = _ERROR, facts.failure
    elif facts.lost:
        level, message = _WARN, f'{facts.lost} messages are lost'
    values = {'recorded messages': facts.recorded, 'lost messages': facts.lost}
    return _status('bag', level, message, values)


def _status(
    name: str, level: bytes, message: str, values: Mapping[str, object]
) -> DiagnosticStatus:
    """Return a status with the values that are not None."""
    known = [KeyValue(key=key, value=str(each)) for key, each in values.items() if each is not None]
    return DiagnosticStatus(
        level=level, name=name, message=message, hardware_id='barc_sim', values=known
    )
