"""Criteria in words."""

from __future__ import annotations

_LABELS = {
    'model.x': 'Model: position x',
    'model.y': 'Model: position y',
    'model.psi': 'Model: heading \N{GREEK SMALL LETTER PSI}',
    'model.v': 'Model: speed v',
    'model.trajectory': 'Model: a whole drive',
    'pid.proportional': 'PID: proportional term',
    'pid.integral': 'PID: integral term',
    'pid.derivative': 'PID: derivative term',
    'pid.windup': 'PID: integral at the limit',
    'pid.reset': 'PID: fresh start of a new run',
    'loop.lab_road': "Cruise control: the lab's road",
    'loop.random_roads': 'Cruise control: other roads',
}


def label(criterion: str) -> str:
    """Return what a criterion is called where people read it."""
    return _LABELS.get(criterion, criterion)
