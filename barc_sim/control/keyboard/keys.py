"""Keys of a terminal: decodes their bytes, and turns the held keys into a driver's input.

The decoding is by hand. Libraries for terminals (curses, prompt_toolkit) report no releases of
keys, which the kitty protocol does, or take over the whole screen, where the run draws its line.
"""

from __future__ import annotations

import re
from math import inf
from typing import TYPE_CHECKING, NamedTuple

from barc_sim.control.driver import COAST, FULL_BRAKE, DriverInput
from barc_sim.vehicle.parameters import Parameter

if TYPE_CHECKING:
    from collections.abc import Iterator

#: [s] A first press lasts longer than the usual delay before the first repeat (0.5 s), and a repeat
#: longer than the usual time to the next one.
PRESS_HOLD = 0.6
REPEAT_HOLD = 0.15
PARAMETERS = [
    Parameter(
        'press_hold',
        PRESS_HOLD,
        'time [s] for which a key counts as held after a press; longer than the delay before the '
        'key repeats',
        (0.05, 5.0),
        read_only=True,
    ),
    Parameter(
        'repeat_hold',
        REPEAT_HOLD,
        'time [s] for which a key counts as held after each repeat',
        (0.05, 5.0),
        read_only=True,
    ),
]

_ARROWS = {'A': 'up', 'B': 'down', 'C': 'right', 'D': 'left'}
_LETTERS = {
    'w': 'up',
    's': 'down',
    'd': 'right',
    'a': 'left',
    ' ': 'space',
    'r': 'reset',
    'q': 'quit',
    '\x03': 'quit',
}
_DRIVING = ('up', 'down', 'left', 'right', 'space')
_CTRL = 4  # in the protocol's sum of modifiers
_RELEASE = 3
_PASTE_BEGINS, _PASTE_ENDS = '200~', '201~'
#: A longer sequence is discarded.
_LONGEST = 64
_SEQUENCE = re.compile(r'(?P<code>\d*)(?::\d*)*(?:;(?P<modifiers>\d*)(?::(?P<event>\d*))?)?')


class KeyEvent(NamedTuple):
    """A key that was pressed, or released if the terminal reports that.

    Examples
    --------
    >>> KeyEvent('up', released=True).released
    True
    """

    key: str  #: up, down, left, right, space, reset or quit; `blur`: the window lost the focus,
    #: `kitty`: the terminal offers the kitty keyboard protocol
    released: bool = False


class KeyDecoder:
    """Decodes the bytes that a terminal sends; a sequence may arrive in any number of pieces.

    It decodes plain keys, the arrows in both of their modes, the kitty keyboard protocol
    (https://sw.kovidgoyal.net/kitty/keyboard-protocol/) and focus reports. It ignores pasted text,
    all other bytes, and a key after a lone Escape, which is how a terminal sends Alt. Ctrl-C is
    never ignored.

    Examples
    --------
    >>> [event.key for event in KeyDecoder().decode(bytes([27]) + b'[A')]
    ['up']
    """

    def __init__(self) -> None:
        """Begin outside of any sequence."""
        self._sequence = ''
        self._pasting = False

    def decode(self, data: bytes) -> Iterator[KeyEvent]:
        """Yield the events that end in `data`."""
        for character in data.decode('latin-1'):
            yield from self._take(character)

    def _take(self, character: str) -> Iterator[KeyEvent]:
        sequence = self._sequence + character
        self._sequence = ''
        if character == '\x1b':
            self._sequence = character
        elif character < ' ' or len(sequence) == 1:
            key = _LETTERS.get(character.lower())
            if key and (character == '\x03' or not self._pasting):
                yield KeyEvent(key)
        elif sequence in {'\x1b[', '\x1bO'} or (
            sequence[1] == '[' and character < '@' and len(sequence) < _LONGEST
        ):
            self._sequence = sequence
        elif sequence[1] in '[O' and len(sequence) > 2:  # noqa: PLR2004 (more than it begins with)
            yield from self._end(sequence[2:])

    def _end(self, body: str) -> Iterator[KeyEvent]:
        """Yield what the sequence ESC [ `body` means."""
        if body in {_PASTE_BEGINS, _PASTE_ENDS}:
            self._pasting = body == _PASTE_BEGINS
        elif self._pasting:
            pass
        elif body == 'O':
            yield KeyEvent('blur')
        elif body[0] == '?' and body[-1] == 'u':
            yield KeyEvent('kitty')
        elif match := _SEQUENCE.fullmatch(body, 0, len(body) - 1):
            yield from _key(match, body[-1])


def _key(match: re.Match[str], final: str) -> Iterator[KeyEvent]:
    code, modifiers, event = (int(group) if group else 1 for group in match.groups())
    key = None
    if final in _ARROWS:
        key = _ARROWS[final]
    elif final == 'u' and (modifiers - 1) & _CTRL:
        key = 'quit' if code == ord('c') else None
    elif final == 'u' and code < 0x80:  # noqa: PLR2004 (ASCII)
        key = _LETTERS.get(chr(code).lower())
    if key:
        yield KeyEvent(key, released=event == _RELEASE)


class HeldKeys:
    """The keys that are held, and the driver's input that they make.

    Most terminals report no release. There a key counts as held for `press_hold` after it was
    pressed, and for `repeat_hold` after each repeat. Only the key pressed last repeats.

    Attributes
    ----------
    releases
        Whether the terminal reports releases; the terminal sets it once one was reported.

    Examples
    --------
    >>> keys = HeldKeys()
    >>> keys.handle(KeyEvent('up'), t=0.0)
    True
    >>> keys.request(t=0.1)
    DriverInput(forward=1.0, turn=0.0, brake=0.0)
    """

    def __init__(self, press_hold: float = PRESS_HOLD, repeat_hold: float = REPEAT_HOLD) -> None:
        """Begin with nothing held; times in seconds."""
        self.releases = False
        self._press_hold, self._repeat_hold = press_hold, repeat_hold
        self._until: dict[str, float] = {}
        self._previous = COAST

    def handle(self, event: KeyEvent, t: float) -> bool:
        """Handle an `event` at `t` [s]; return whether it is a new press, not a repeat."""
        if event.key in ('kitty', 'blur'):
            self.releases = self.releases or event.key == 'kitty'
            if event.key == 'blur':
                self._until.clear()
            return False
        until = self._until.pop(event.key, -inf)
        if event.released:
            return False
        pressed = until < t
        if self.releases:
            until = inf
        else:
            until = max(until, t + (self._press_hold if pressed else self._repeat_hold))
        self._until[event.key] = until
        return pressed

    def held(self, t: float) -> tuple[str, ...]:
        """Return the driving keys held at `t` [s]."""
        return tuple(key for key in _DRIVING if self._until.get(key, -inf) >= t)

    def request(self, t: float) -> DriverInput | None:
        """Return the driver's input at `t` [s]; after the release, coasting once and then None.

        Nothing follows the brake, so that it stays on.
        """
        held = self.held(t)
        request = DriverInput(
            forward=float('up' in held) - float('down' in held),
            turn=float('left' in held) - float('right' in held),
        )
        if 'space' in held:
            request = FULL_BRAKE
        previous, self._previous = self._previous, request
        return request if held or previous not in {COAST, FULL_BRAKE} else None
