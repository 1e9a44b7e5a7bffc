"""Functions of a user's file that a law judges: the same arguments always give the same."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from barc_sim.lab.check.code import Finding, JudgedCode, rows_of
from barc_sim.lab.check.laws import Judge, close, run

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from barc_sim.lab.check.laws import Agree, Index, Inputs, Law, Trial

_MIN_LOSS = 0.1  #: of a result's points


@dataclass(frozen=True)
class Functions:
    """The functions of a file, with the law of their results; a situation has their names."""

    law: Law
    inputs: Mapping[str, str]  #: that a sentence shows, by function
    results: Mapping[str, tuple[str, ...]]  #: all numbers that it returns, by function
    criteria: Mapping[str, str]  #: by result that is judged, in the order of a report
    count: int = 100  #: calls in each situation
    agree: Agree = close
    #: Makes the arguments of each call of the inputs; without it, they are those.
    arguments: Callable[[Inputs], list[list[Any]]] | None = None

    @np.errstate(all='ignore')
    def judge(self, code: JudgedCode, seed: int | str) -> tuple[list[Finding], list[Trial]]:
        """Return a finding for each result that is judged, and all that was returned."""
        trials: list[Trial] = []
        for name, results in self.results.items():
            call = partial(self._called, code, name)
            trials += run(call, results, self.law.situations[name], seed, self.count)
        judge = Judge(self.law, self.agree, self._shown, partial(self._line, code), _MIN_LOSS)
        judged = [
            each._replace(got={n: got for n, got in each.got.items() if n in self.criteria})
            for each in trials
        ]
        findings = []
        for name, verdict in judge.judge(judged, self.criteria).items():
            cases = self.count * sum(name in trial.got for trial in trials)
            message = verdict.message or f'right in all {cases} cases'
            findings.append(Finding(self.criteria[name], verdict.score, message))
        return findings, trials

    def _called(self, code: JudgedCode, name: str, inputs: Inputs) -> list[Any]:
        rows = self._rows(name, inputs)
        found = code.call('functions', name, rows)
        return rows_of(name, found, len(rows), len(self.results[name]))

    def _rows(self, name: str, inputs: Inputs) -> list[list[Any]]:
        if self.arguments:
            return self.arguments(inputs)
        rows: list[list[Any]] = np.array([inputs[n] for n in self.inputs[name].split()]).T.tolist()
        return rows

    def _function(self, trial: Trial) -> str:
        names = (name for name, results in self.results.items() if {*results} >= {*trial.got})
        return next(names)

    def _line(
        self, code: JudgedCode, trial: Trial, name: str, index: Index, wrong: list[float]
    ) -> str:
        function, (k,) = self._function(trial), index
        rows = self._rows(function, {n: each[k : k + 1] for n, each in trial.inputs.items()})
        others = [each for each in rows[0] if isinstance(each, float)]
        others += [float(self.law.right(trial.inputs, n)[0][k]) for n in trial.got if n != name]
        return code.line_of('functions', (function, rows), wrong, others)

    def _shown(self, trial: Trial, index: Index) -> str:
        function = self._function(trial)
        names = self.inputs[function].split()
        values = (f'{name}={trial.inputs[name][index]:.6g}' for name in names)
        return f'{function}({", ".join(values)})'
