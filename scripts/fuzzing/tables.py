"""CSV files of roads, tracks and references: damaged, and with generated headers, rows and shapes.

Each is read as `--road`, `--track` and `--reference` do; a track that is read is driven on, too.
"""

from __future__ import annotations

from math import cos, isfinite, pi, sin
from typing import TYPE_CHECKING

from _bytes import TEXTS, damage

from barc_sim.control.cruise_control import reference_of
from barc_sim.control.lane import speed_profile
from barc_sim.errors import UserError
from barc_sim.vehicle.road import Road
from barc_sim.vehicle.track import Track

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from pathlib import Path
    from random import Random

_HEADERS = (
    'start_m,grade_deg',
    'length_m,radius_m',
    'x_m,y_m,w_tr_right_m,w_tr_left_m',
    'x_m,y_m,w_tr_right_m,w_tr_left_m,speed_mps',
    'time_s,speed_mps',
    'distance_m,speed_mps',
    's_m,x_m,y_m,psi_rad,kappa_radpm,vx_mps,ax_mps2',
)
_NUMBERS = (
    *('', ' ', 'nan', 'inf', '-inf', '1e308', '-1e308', '1e-320', '0', '-0', '1e5', '0x10', '1_0'),
    *('1,5', '"1"', '"', '٣', '1e400', '--1', '#', ';', '\t'),
)
_MAX_COLUMNS = 20
_ENCODINGS = ('utf-8', 'utf-8-sig', 'latin-1', 'utf-16', 'cp1252')
_DELIMITERS = (',', ', ', ';', '; ', '\t', ' , ', '|', ' ')
_ENDS = ('\n', '\r\n', '\r', '\n\n', '\u2028', '\x0c')
_COMMENTS = ('# made by hand', '#', '# 603fd3987364b09f', '; x', '// x', 'Zoë', '', '"')


def original() -> None:
    """Do nothing: the files are made as they are needed."""


def damaged_file(chance: Random) -> tuple[str, str, bytes]:
    """Return the suffix of a file, what is odd about it, and its content."""
    match chance.randrange(4):
        case 0:
            return '.csv', 'any bytes of a .csv', damage(_table(chance, 0.0).encode(), chance)
        case 1:
            return '.csv', 'numbers', _table(chance, chance.choice((0.01, 0.1, 1.0))).encode()
        case 2:
            table = _table(chance, 0.0, _mangle(chance.choice(_HEADERS), chance))
            return '.csv', 'headers', table.encode('utf-8', 'surrogatepass')
    text = _table(chance, 0.0)
    return '.csv', 'encodings', text.encode(chance.choice(_ENCODINGS), 'replace')


def _mangle(header: str, chance: Random) -> str:
    """Return a header in another form, or with another text in it."""
    names = header.split(',')
    match chance.randrange(6):
        case 0:
            chance.shuffle(names)
        case 1:
            names[chance.randrange(len(names))] = chance.choice(TEXTS)
        case 2:
            del names[chance.randrange(len(names))]
        case 3:
            names = [name.upper() for name in names]
        case 4:
            names.insert(chance.randrange(len(names)), chance.choice(names))
    return ','.join(names)


def _table(chance: Random, share: float, header: str = '') -> str:
    """Return the text of a file, with odd numbers in this `share` of its cells."""
    header = header or chance.choice(_HEADERS)
    columns = header.split(',')[:_MAX_COLUMNS]
    delimiter = _odd_at_times(_DELIMITERS, chance)
    lines = [chance.choice(_COMMENTS) for _ in range(chance.choice((0, 0, 0, 0, 1, 3)))]
    lines.append(chance.choice(('', '', '#', '# ', '  #')) + delimiter.join(columns))

    for row in _rows(columns, chance):
        cells = [f'{number:.{chance.choice((1, 6, 17))}g}' for number in row]
        cells = [chance.choice(_NUMBERS) if chance.random() < share else cell for cell in cells]
        lines.append(delimiter.join(cells))
        if chance.random() < 0.001:  # noqa: PLR2004 (now and then)
            lines.append(chance.choice(_COMMENTS))
    return _odd_at_times(_ENDS, chance).join(lines)


def _odd_at_times(texts: Sequence[str], chance: Random) -> str:
    """Return the first text, which is the usual one, or sometimes any of them."""
    if chance.random() < 0.3:  # noqa: PLR2004
        return chance.choice(texts)
    return texts[0]


def _rows(columns: list[str], chance: Random) -> list[list[float]]:
    """Return rows of numbers: a closed line if there are x and y, else rising numbers."""
    n = chance.choice((0, 1, 2, 3, 10, 100, 1000, 3000))
    if 'x_m' in columns:
        return _closed_line(n, len(columns) - 2, chance)

    rows = []
    for k in range(n):
        first = 10.0 * k + chance.random() + 0.1
        rows.append([first, *(chance.uniform(4.0, 9.0) for _ in columns[1:])])
    return rows


def _closed_line(n: int, widths: int, chance: Random) -> list[list[float]]:
    """Return `n` rows with x, y and a number of widths."""
    size = 10.0 ** chance.uniform(-3.0, 5.0)
    laps = chance.choice((0.5, 0.95, 1.0, 1.0, 1.05, 1.5, 3.0))
    lobes = chance.randint(1, 9)
    depth = chance.choice((0.0, 0.1, 0.5, 1.2))
    noise = size * chance.choice((0.0, 0.0, 1e-4, 1e-2))

    rows = []
    for k in range(n):
        angle = 2.0 * pi * laps * k / max(n, 1)
        radius = size * (1.0 + depth * cos(lobes * angle)) + chance.gauss(0.0, noise)
        width = 0.05 * size
        if chance.random() < 0.01:  # noqa: PLR2004 (now and then)
            width = size * chance.choice((0.05, 0.05, 0.2))
        rows.append([radius * cos(angle), radius * sin(angle), *[width] * widths])

    if rows and chance.random() < 0.2:  # noqa: PLR2004
        rows.insert(chance.randrange(len(rows)), chance.choice(rows))
    return rows


def _drive_on(path: Path) -> None:
    """Read a track, and use it where a run does."""
    track = Track.named(str(path))
    profile = speed_profile(track, 10.0, 3.0, 2.0)
    for share in (0.0, 0.3, 0.999):
        s = share * track.length
        e_y = 0.3 * track.width
        position = track.frenet(*track.place(s, e_y), s)
        if not (isfinite(position.s) and isfinite(profile(0.0, s))):
            raise AssertionError(f'{position} at {s}')
    track.lines()


def _climb(path: Path) -> None:
    road = Road.named(str(path))
    if not isfinite(road.at(1.0).elevation + road.horizontal(1.0)):
        raise AssertionError(str(road.at(1.0)))


def _refer(path: Path) -> None:
    speed = reference_of(str(path))(1.0, 1.0)
    if not isfinite(speed):
        raise AssertionError(str(speed))


def _accepts(use: Callable[[Path], object], path: Path) -> bool:
    try:
        use(path)
    except UserError:
        return False
    return True


def _read(path: Path) -> None:
    """Read a file as each option does; UserError: none accepts it."""
    accepted = [_accepts(use, path) for use in (_drive_on, _climb, _refer)]
    if not any(accepted):
        raise UserError('no option accepts it')


def uses(_: Random) -> list[Callable[[Path], object]]:
    """Return what to do with a file."""
    return [_read]
