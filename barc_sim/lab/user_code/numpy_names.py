"""Gives user code the names of NumPy 1 and of NumPy 2, whichever version is installed.

The scores of a file then do not depend on the version in which a name was removed or added.
"""

from __future__ import annotations

from functools import cache
from types import ModuleType
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Callable

#: Names that NumPy has removed, and what has the same meaning in every version.
REMOVED: dict[str, Any] = {
    **dict.fromkeys(('Inf', 'Infinity', 'infty', 'PINF'), np.inf),
    'NINF': -np.inf,
    **dict.fromkeys(('NaN', 'NAN'), np.nan),
    'PZERO': 0.0,
    'NZERO': -0.0,
    'float': float,
    'int': int,
    'complex': complex,
    'object': object,
    'str': str,
    'float_': np.float64,
    'complex_': np.complex128,
    'unicode_': np.str_,
    'string_': np.bytes_,
    'alltrue': np.all,
    'sometrue': np.any,
    'product': np.prod,
    'cumproduct': np.cumprod,
    'round_': np.round,
    'row_stack': np.vstack,
    'in1d': lambda a, b, **options: np.isin(np.ravel(a), b, **options),
    'asfarray': lambda a: np.asarray(a, np.float64),
    'trapz': vars(np).get('trapezoid', vars(np).get('trapz')),
    'msort': lambda a: np.sort(a, axis=0),
}
#: Names that NumPy 2 has added, by the older name.
ADDED = {
    'acos': 'arccos',
    'acosh': 'arccosh',
    'asin': 'arcsin',
    'asinh': 'arcsinh',
    'atan': 'arctan',
    'atan2': 'arctan2',
    'atanh': 'arctanh',
    'bool': 'bool_',
    'concat': 'concatenate',
    'permute_dims': 'transpose',
    'pow': 'power',
    'trapezoid': 'trapz',
}


@cache
def _added(name: str) -> Any:  # noqa: ANN401 (any value of NumPy)
    """Return the value of a name that NumPy 2 has added."""
    return vars(np)[name if name in vars(np) else ADDED[name]]


class NumPy(ModuleType):
    """The module `numpy` with the names of other versions."""

    def __init__(self, note: Callable[[str], object]) -> None:
        """Call `note` with a phrase when user code uses a name that NumPy has removed."""
        super().__init__('numpy', np.__doc__)
        # NumPy's own `__getattr__` would come before the one below.
        left_out = {*REMOVED, '__getattr__'}
        own = {name: value for name, value in vars(np).items() if name not in left_out}
        vars(self).update(own)
        self._note = note

    def __getattr__(self, name: str) -> Any:  # noqa: ANN401 (any value of NumPy)
        """Return the value of a name that NumPy itself loads late, has removed or added."""
        if name in REMOVED:
            self._note(f'np.{name} is no name of NumPy 2 any more: it still works here')
            return REMOVED[name]
        return _added(name) if name in ADDED else getattr(np, name)
