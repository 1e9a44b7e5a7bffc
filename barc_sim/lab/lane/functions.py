"""Judges the functions of `lane.py`: the errors beside a straight and an arc, the steady turn."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from itertools import count
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from barc_sim.lab.check.code import Finding, JudgedCode, numbers_of, rows_of
from barc_sim.lab.check.laws import Judge, close, read, run
from barc_sim.vehicle.bike_model import L_F, L_R

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from barc_sim.lab.check.laws import Floats, Index, Inputs, Trial
    from barc_sim.vehicle.track import Track

LABELS = {
    'errors.straight_e_y': 'Errors: e_y beside a straight',
    'errors.straight_e_psi': 'Errors: e_psi beside a straight',
    'errors.arc_e_y': 'Errors: e_y beside an arc',
    'errors.arc_e_psi': 'Errors: e_psi beside an arc',
    'steady.delta': 'Steady turn: steering',
    'steady.e_psi': 'Steady turn: e_psi',
}
#: The arguments of each function, and its results.
_FUNCTIONS = {
    'straight_errors': ('x y psi x_0 y_0 psi_0', ('straight_e_y', 'straight_e_psi')),
    'arc_errors': ('x y psi x_c y_c radius', ('arc_e_y', 'arc_e_psi')),
    'steady': ('curvature', ('steady_delta', 'steady_e_psi')),
}
_STATES = 100  #: of each situation
_MIN_LOSS = 0.1  #: of a result's points


def _wrapped(angle: Floats) -> Floats:
    return np.arctan2(np.sin(angle), np.cos(angle))


LAW = replace(
    read(Path(__file__).with_name('lane.txt'), L_F=L_F, L_R=L_R),
    functions={
        'wrapped': _wrapped,
        'hypot': np.hypot,
        'sqrt': np.sqrt,
        'arcsin': np.arcsin,
    },
)
#: The function of each situation.
_CALLED = {each.name: function for function, all_ in LAW.situations.items() for each in all_}


class LaneCode(JudgedCode):
    """A user's `lane.py`."""

    _lanes = count()

    def called(self, do: str, *arguments: Any) -> str:  # noqa: ANN401 (JSON)
        """Return the user's name for what a request calls."""
        return {'functions': str(arguments[0]) if arguments else '', 'notes': do}.get(do, 'Lane')

    def function(self, name: str, rows: Sequence[Sequence[float]]) -> list[tuple[float, float]]:
        """Return the result of a function for each row of its arguments."""
        return rows_of(name, self.call('functions', name, rows), len(rows), 2)

    def new_lane(self, track: Track, sign: float = 1.0) -> int:
        """Return the number of a new `Lane` on a track; its file is loaded again.

        It reads the curvature times `sign`.
        """
        number = next(self._lanes)
        self.call('new_lane', number, track.starts[1:], [sign * each for each in track.curvatures])
        return number

    def steer(self, number: int, row: Sequence[float]) -> float:
        """Return the steering angle [rad] of a `Lane` for e_y, e_psi, speed and place."""
        return numbers_of('Lane', self.call('steer', number, [row]), 1)[0]


@np.errstate(all='ignore')
def judge_functions(code: LaneCode, seed: int) -> Iterator[Finding]:
    """Yield a finding for each result of the three functions."""
    trials: list[Trial] = []
    for name, (_, results) in _FUNCTIONS.items():

        def call(inputs: Inputs, name: str = name) -> list[tuple[float, float]]:
            return code.function(name, _arguments(name, inputs))

        trials += run(call, results, LAW.situations[name], seed, _STATES)
    judge = Judge(LAW, close, _call, partial(_line, code), _MIN_LOSS)
    names = [name for _, own in _FUNCTIONS.values() for name in own]
    verdicts = judge.judge(trials, names)
    for criterion, name in zip(LABELS, names, strict=True):
        states = _STATES * sum(name in trial.got for trial in trials)
        message = verdicts[name].message or f'right in all {states} cases'
        yield Finding(criterion, verdicts[name].score, message)


def _arguments(name: str, inputs: Inputs, part: slice = slice(None)) -> list[list[float]]:
    columns = [inputs[each][part] for each in _FUNCTIONS[name][0].split()]
    rows: list[list[float]] = np.array(columns).T.tolist()
    return rows


def _line(code: LaneCode, trial: Trial, name: str, index: Index, wrong: list[float]) -> str:
    function = _CALLED[trial.name]
    rows = _arguments(function, trial.inputs, slice(index[0], index[0] + 1))
    right = [float(LAW.right(trial.inputs, each)[0][index]) for each in trial.got if each != name]
    return code.line_of('functions', (function, rows), wrong, [*rows[0], *right])


def _call(trial: Trial, index: Index) -> str:
    function = _CALLED[trial.name]
    names = _FUNCTIONS[function][0].split()
    values = (f'{name}={trial.inputs[name][index]:.6g}' for name in names)
    return f'{function}({", ".join(values)})'
