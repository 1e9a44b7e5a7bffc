"""Text for reports: what submissions have written, made safe to show, and the names of criteria."""

from __future__ import annotations


def printable(text: str) -> str:
    """Return `text` without characters that control terminals or text direction."""
    return ''.join(
        c if c.isprintable() or c in '\n\t' else '\N{REPLACEMENT CHARACTER}' for c in text
    )


def one_line(text: str, width: int = 400) -> str:
    """Return `text` as one printable line of at most `width` characters.

    Examples
    --------
    >>> one_line('a sentence   of many words', width=10)
    'a sentenc…'
    """
    line = ' '.join(printable(text).split())
    return line if len(line) <= width else f'{line[: width - 1]}\N{HORIZONTAL ELLIPSIS}'


_LABELS = {
    'model.x': 'Model: position x',
    'model.y': 'Model: position y',
    'model.psi': 'Model: heading \N{GREEK SMALL LETTER PSI}',
    'model.v': 'Model: speed v',
    'model.trajectory': 'Model: a whole drive',
    'model.reverse': 'Model: in reverse',
    'model.general': 'Model: another car',
    'pid.proportional': 'PID: proportional term',
    'pid.integral': 'PID: integral term',
    'pid.derivative': 'PID: derivative term',
    'pid.dt': 'PID: the time step',
    'pid.first_call': 'PID: the first call',
    'pid.windup': 'PID: integral at the limit',
    'pid.reset': 'PID: fresh start of a new run',
    'loop.lab_road': "Cruise control: the lab's road",
    'loop.random_roads': 'Cruise control: other roads',
    'relay.forward': 'Relay: up and down',
    'relay.steering': 'Relay: left and right',
    'relay.units': 'Relay: m/s² and radians',
    'relay.release': 'Relay: a released key',
    'relay.rate': 'Relay: commands a second',
    'relay.limits': "Relay: the car's limits",
    'relay.silence': 'Relay: no driver',
}


def label(criterion: str) -> str:
    """Return the name of a criterion for readers.

    Examples
    --------
    >>> label('model.x')
    'Model: position x'
    """
    return _LABELS.get(criterion, criterion)
