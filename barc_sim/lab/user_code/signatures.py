"""The arguments that a user's function takes, from its signature."""

from __future__ import annotations

import re
from inspect import Parameter, Signature, signature
from typing import TYPE_CHECKING, Any

from barc_sim.lab.user_code.call import defined_at, guarded, short_repr
from barc_sim.lab.user_code.source import UserCodeError

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from barc_sim.lab.user_code.importing import Folder

#: Names of a gain, in lower case: kp, k_p, p, p_gain, gain_p, kpgain, proportional, …
_GAIN = re.compile(
    r'(?:k|gain|coeff)?_?([pid])(?:rop|nt|er)?(?:ortional|egral|ivative)?_?(?:gain|term|coeff)?'
)
_EVERY_KIND = Parameter.VAR_KEYWORD


def check_takes(folder: Folder, function: Callable[..., Any], names: Sequence[str]) -> None:
    """Refuse a function that does not take the arguments `names`."""
    found = _signature(folder, function)
    if not _binds(found, len(names)):
        raise _takes(folder, function, found, names)


def dt_name(folder: Folder, function: Callable[..., Any], names: Sequence[str]) -> str:
    """Return the name of the time step among the arguments of `function`, empty if there is none.

    That is `dt`, or the one required argument after `names`.
    """
    found = _signature(folder, function)
    count = len(names)
    if 'dt' in found.parameters and _binds(found, count, dt=0.0):
        return 'dt'
    if _binds(found, count):
        return ''
    for name in list(found.parameters)[count:]:
        if _binds(found, count, **{name: 0.0}):
            return name
    raise _takes(folder, function, found, names)


def gain_names(parameters: Sequence[str]) -> tuple[str, ...]:
    """Return those of `parameters` that are kp, ki and kd: by their names, else the first three.

    Examples
    --------
    >>> gain_names(['kp', 'ki', 'kd']), gain_names(['p', 'i', 'd'])
    (('kp', 'ki', 'kd'), ('p', 'i', 'd'))
    """
    found: dict[str, str] = {}
    for name in parameters:
        if match := _GAIN.fullmatch(name.lower()):
            found.setdefault(match[1], name)
    names = tuple(found[letter] for letter in 'pid' if letter in found)
    return names if len(names) == len('pid') else tuple(parameters[:3])


def _signature(folder: Folder, function: Callable[..., Any]) -> Signature:
    try:
        return signature(function)
    except Exception as error:
        raise UserCodeError(
            f'{defined_at(folder, function)}: expected a function, got {short_repr(function)}'
        ) from error


def _takes(
    folder: Folder, function: Callable[..., Any], found: Signature, names: Sequence[str]
) -> UserCodeError:
    name = guarded(getattr, function, '__name__', default=short_repr(function))
    return UserCodeError(
        f'{defined_at(folder, function)}: {name} takes ({", ".join(found.parameters)}); '
        f'expected ({", ".join(names)})'
    )


def _binds(found: Signature, count: int, **options: float) -> bool:
    try:
        found.bind(*range(count), **options)
    except TypeError:
        return False
    return True


def options_for(
    function: Callable[..., Any], names: Sequence[str]
) -> Callable[[dict[str, float]], dict[str, float]]:
    """Return a function that selects the options that `function` takes after `names`."""
    parameters = list(signature(function).parameters.values())
    if any(parameter.kind is _EVERY_KIND for parameter in parameters):
        return lambda options: options
    taken = {parameter.name for parameter in parameters[len(names) :]}
    if not taken:
        return lambda _: {}
    return lambda options: {name: options[name] for name in options if name in taken}
