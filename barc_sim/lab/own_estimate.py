"""Calls a student's `estimate` with the bag of a drive, and prints its six numbers: for Lab 5."""

from __future__ import annotations

import json
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

from barc_sim.bags import reader
from barc_sim.errors import UserError
from barc_sim.lab.files import CALLED, IDENTIFY

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence

UNITS = {'drag': '1/m', 'friction': 'm/s²', 'delay': 's'}


def print_estimate(estimate: Callable[..., Sequence[float]], bags: Iterable[str]) -> None:
    """Print what `estimate` returns for the last drive with an `identify.py` among `bags`.

    Parameters
    ----------
    estimate
        The function of `identify.py`.
    bags
        Paths of bags, such as those of `bags/*`. Those of other drives are left out.

    Raises
    ------
    SystemExit
        No bag is one of a drive with an `identify.py`, or `estimate` does not return six numbers;
        its text is a sentence.
    """
    try:
        path = _last_drive([*map(Path, bags)])
        log = reader.read(path)
    except UserError as error:
        raise SystemExit(str(error)) from None

    numbers = [*map(float, estimate(log.t.tolist(), log.v_x.tolist(), log.motor.tolist()))]
    expected = CALLED['estimate']
    if len(numbers) != expected.numbers:
        raise SystemExit(f'estimate returned {len(numbers)} numbers: expected {expected.returns}')

    print(path)  # noqa: T201
    for k, (name, unit) in enumerate(UNITS.items()):
        print(f'{name:9} {numbers[2 * k]:.6g} ± {numbers[2 * k + 1]:.2g} {unit}')  # noqa: T201


def _last_drive(bags: Sequence[Path]) -> Path:
    """Return the last bag of a drive with an `identify.py`."""
    for bag in reversed(bags):
        with suppress(UserError):  # other files are beside the bags, too
            if _has_commands(reader.info(bag)):
                return bag
    raise UserError(
        f'none of {len(bags)} bags is one of a drive with an identify.py: drive with '
        f'barc {IDENTIFY.drive} . first'
    )


def _has_commands(info: dict[str, str]) -> bool:
    """Return whether the commands of a drive came from an `identify.py`, by its bag's metadata."""
    code: Any = None
    with suppress(ValueError):
        code = json.loads(info.get('student_code', ''))
    files = code.get('files') if isinstance(code, dict) else None
    return isinstance(files, dict) and 'identify' in files
