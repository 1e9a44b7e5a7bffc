"""Messages of a fixed layout as CDR, without message objects.

CDR is the encoding of DDS (OMG formal/2008-01-04, 15.3, PLAIN_CDR). A message here begins with a
header or a time; doubles follow, and then flags. Each field then has a fixed place in the bytes, as
long as the header's frame is empty, so that a `struct` can pack the whole message.
"""

from __future__ import annotations

import re
from operator import itemgetter
from struct import Struct
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

NANOSECONDS = 1_000_000_000
HEADER, TIME = 'std_msgs/msg/Header', 'builtin_interfaces/msg/Time'

_LITTLE_ENDIAN = b'\0\1\0\0'
_STAMP = slice(4, 12)
_LAST = 2**31 - 1  #: [s]
_TIMES = (Struct('>iI'), Struct('<iI'))  # big-endian, little-endian
_NO_FRAME = b'\1\0\0\0\0'  # an empty string: its length with the final zero, and that zero
_FRAME = slice(12, 17)
#: By the type of a message's first field: what is packed before the others. A double begins at a
#: multiple of 8, counted from behind the four bytes that name the encoding.
_LEADING = {HEADER: '<4siI5s3x', TIME: '<4siI'}
_KINDS = {kind.replace('/msg', each): kind for kind in _LEADING for each in ('/msg', '')}
_CODES = {'float64': 'd', 'double': 'd', 'bool': '?', 'boolean': '?'}


def leading_time(data: bytes) -> int:
    """Return the time [ns] at the start of a serialized message: a header's stamp, or a clock."""
    sec, nanosec = _TIMES[data[1] & 1].unpack(data[_STAMP])
    return int(sec) * NANOSECONDS + int(nanosec)


def split_time(stamp: int) -> tuple[int, int]:
    """Return a time [ns] as seconds and nanoseconds; the inverse of `leading_time`.

    Nanoseconds beyond a second stay where the seconds are at their end, as a stranger may send it.
    """
    sec, nanosec = divmod(stamp, NANOSECONDS)
    return (sec, nanosec) if sec <= _LAST else (_LAST, stamp - _LAST * NANOSECONDS)


class FixedLayout:
    """Where the fields of a message lie in its bytes.

    Attributes
    ----------
    names
        The fields after the first, in order.
    """

    def __init__(self, leading: str, names: Sequence[str], codes: str) -> None:
        """Lay out the fields `names`, of the `struct` codes `codes`, behind the kind `leading`."""
        self.names = tuple(names)
        struct = Struct(_LEADING[leading] + codes)
        self._pack, self._unpack, self._size = struct.pack, struct.unpack_from, struct.size
        self._frame = (_NO_FRAME,) if leading == HEADER else ()

    def pack(self, stamp: int, fields: Mapping[str, float]) -> bytes:
        """Return the message stamped `stamp` [ns] with `fields`, by name."""
        values = map(fields.__getitem__, self.names)
        return self._pack(_LITTLE_ENDIAN, *split_time(stamp), *self._frame, *values)

    def fits(self, data: bytes) -> bool:
        """Return whether `data`, of this type, has this layout: its frame is empty."""
        return (
            data[:4] == _LITTLE_ENDIAN
            and len(data) >= self._size
            and (not self._frame or data[_FRAME] == _NO_FRAME)
        )

    def reader(self, *names: str) -> Callable[[bytes], Any]:
        """Return a function that reads these fields of a message that `fits`.

        It returns the value of a single name, or the values of several.
        """
        before = 3 + len(self._frame)
        select = itemgetter(*(before + self.names.index(name) for name in names))
        unpack = self._unpack
        return lambda data: select(unpack(data))


def fixed_layout(fields: Mapping[str, Any]) -> FixedLayout | None:
    """Return the layout of a message with these kinds of fields, by name; None if it has none.

    The kinds are those of a `.msg` file, or those of a class of rclpy.
    """
    first, *names = fields or ('',)
    leading = _KINDS.get(fields.get(first, ''))
    codes = ''.join(_CODES.get(fields[name], ' ') for name in names)
    # Doubles are aligned behind a header alone; flags need no alignment.
    fixed = re.fullmatch(r'\?*' if leading == TIME else r'd+\?*', codes)
    return FixedLayout(leading, names, codes) if leading and fixed else None
