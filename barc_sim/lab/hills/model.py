"""Judges `bikeFE`: each equation in seeded states.

No state passes through zero speed within a step: sensible models differ there. barc_sim's holds the
car at a standstill; the lab's equation does not.
"""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from barc_sim.errors import UserError
from barc_sim.lab.check.code import Finding
from barc_sim.lab.check.laws import Judge, close, read, run
from barc_sim.vehicle.bike_model import GRAVITY, L_F, L_R, Vehicle

if TYPE_CHECKING:
    from collections.abc import Collection, Mapping, Sequence

    from barc_sim.lab.check.laws import Index, Inputs, Situation, Trial, Verdict
    from barc_sim.lab.hills.code import HillsCode

TS = 0.02  #: [s]
EQUATIONS = ('x_next', 'y_next', 'psi_next', 'v_next')  #: in the order of what bikeFE returns
LABELS = {
    'model.x': 'Model: position x',
    'model.y': 'Model: position y',
    'model.psi': 'Model: heading \N{GREEK SMALL LETTER PSI}',
    'model.v': 'Model: speed v',
    'model.reverse': 'Model: in reverse',
    'model.general': 'Model: another car',
}
_LAB = Vehicle()
BIKE = read(
    Path(__file__).with_name('bike.txt'),
    GRAVITY=GRAVITY,
    MASS=_LAB.mass,
    DRAG=_LAB.air_drag_coeff,
    FRICTION=_LAB.friction,
    TS=TS,
    L_F=L_F,
    L_R=L_R,
)
ROAD, REVERSE, GENERAL, LENGTHS = BIKE.situations.values()
*ARGUMENTS, _, _ = ROAD[0].values  #: of bikeFE
_MIN_LOSS = 0.1  #: of an equation's points
_STATES = 250  #: of each situation


@np.errstate(all='ignore')
def judge_model(
    code: HillsCode, seed: int, criteria: Collection[str] = tuple(LABELS)
) -> list[Finding]:
    """Return a finding for each of the four equations on the lab's road, and those beyond it."""
    road = _run(code, seed, ROAD)
    if random := _randomness(code, road):
        return [Finding(name, 0.0, random) for name in LABELS]
    judge = Judge(BIKE, close, _call, partial(_line, code), _MIN_LOSS)
    verdicts = judge.judge(road, EQUATIONS)
    elsewhere, hidden = _hidden(judge, road, *_run(code, seed, LENGTHS))
    findings = []
    for criterion, (name, verdict) in zip(LABELS, verdicts.items(), strict=False):
        message = verdict.message or _right(road)
        if name in hidden:
            message += f' of a car with l_f = l_r; of another one not: {hidden[name]}'
        findings.append(Finding(criterion, verdict.score, message))
    for criterion, situations in {'model.reverse': REVERSE, 'model.general': GENERAL}.items():
        if criterion in criteria:
            trials = _run(code, seed, situations)
            trials += elsewhere if situations is GENERAL else []
            findings.append(Finding(criterion, *_beyond(judge, road, verdicts, trials)))
    return findings


def _run(code: HillsCode, seed: int, situations: Sequence[Situation]) -> list[Trial]:
    """Call `bikeFE` in all of the `situations`."""
    return run(
        lambda inputs: code.bike_fe(*_arguments(inputs)), EQUATIONS, situations, seed, _STATES
    )


def _arguments(inputs: Inputs, part: slice = slice(None)) -> tuple[list[list[float]], float, float]:
    """Return the arguments of calls, and the lengths."""
    rows: list[list[float]] = np.array([inputs[name][part] for name in ARGUMENTS]).T.tolist()
    return rows, float(inputs['l_f'][0]), float(inputs['l_r'][0])


def _hidden(
    judge: Judge, road: Sequence[Trial], trial: Trial
) -> tuple[list[Trial], dict[str, str]]:
    """Return the trial at other axle distances, and the mistakes that show only there.

    Other differences there are no mistake: a file may have 0.5 in place of l_r / (l_f + l_r).
    """
    wrong = [name for name in trial.tests if not judge.is_right(trial, name)]
    if trial.failure or any(judge.loss(road, name) for name in trial.tests):
        return [], {}
    causes = judge.causes([trial], wrong, road)
    named = {n: cause for n, cause in causes.items() if cause.formulas and not cause.is_general}
    others = {name: BIKE.right(trial.inputs, name)[0] for name in EQUATIONS if name not in named}
    texts = {name: judge.placed([trial], name, cause) for name, cause in named.items()}
    return [trial._replace(got={**trial.got, **others})], texts


def _beyond(
    judge: Judge, road: Sequence[Trial], verdicts: Mapping[str, Verdict], trials: Sequence[Trial]
) -> tuple[float, str]:
    """Judge the equations in states that the lab's road has not.

    What follows from a mistake on the road is not taken off again.
    """
    scores: list[float] = []
    wrong: list[str] = []
    for name, verdict in verdicts.items():
        score = 1.0 if verdict.is_named and verdict.score else verdict.score
        if score == 1.0 == verdict.score and (loss := judge.loss(trials, name)):
            score, wrong = 1.0 - loss, [*wrong, name]
        scores.append(score)
    message = _right(trials)
    if wrong:
        # A cause must explain the results on the lab's road, too.
        message = judge.placed(trials, wrong[0], judge.causes(trials, wrong[:1], road)[wrong[0]])
    elif any(verdict.score < 1.0 for verdict in verdicts.values()):
        message = 'no mistake but those above'
    return float(np.mean(scores)), message


def _right(trials: Sequence[Trial]) -> str:
    return f'right in all {len(trials) * _STATES:,} states'


def _line(code: HillsCode, trial: Trial, name: str, index: Index, wrong: list[float]) -> str:
    (k,) = index
    values = {key: float(each[k]) for key, each in trial.known.items()}
    if name == 'v_next':  # the force that follows from it
        rate = (values['got_v_next'] - values['v']) / values['ts']
        wrong = [*wrong, values['m'] * (rate - values['a'])]
    right = [float(BIKE.right(trial.inputs, each)[0][k]) for each in EQUATIONS]
    request = code.request(*_arguments(trial.inputs, slice(k, k + 1)))
    return code.line_of('functions', request, wrong, right)


def _call(trial: Trial, index: Index) -> str:
    values = (f'{name}={trial.inputs[name][index]:.6g}' for name in ARGUMENTS)
    return f'bikeFE({", ".join(values)})'


def _randomness(code: HillsCode, trials: Sequence[Trial]) -> str:
    """Return a message if the same arguments give different results, else an empty string."""
    trial = next((trial for trial in trials if not trial.failure), None)
    if trial is None:
        return ''
    try:
        again = np.array(code.bike_fe(*_arguments(trial.inputs))).T
    except UserError as error:
        return f'a second call with the same arguments fails: {error}'
    before = np.array([*trial.got.values()])
    differing = np.flatnonzero(np.any(before != again, axis=0))
    if not differing.size:
        return ''
    k = int(differing[0])
    first, then = (', '.join(f'{x:.9g}' for x in each[:, k]) for each in (before, again))
    return (
        'the same arguments give different results: does bikeFE use random numbers or change a '
        f'global variable? {_call(trial, (k,))} first gave [{first}], then [{then}]'
    )
