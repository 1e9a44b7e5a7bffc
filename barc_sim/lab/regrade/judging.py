"""Judges whether a bag could have come from the code that it names."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

from barc_sim.control.types import DEFAULT_TYPE, TYPES, new_controller
from barc_sim.errors import UserError
from barc_sim.lab.check.code import Row
from barc_sim.lab.grade.process import check
from barc_sim.lab.grade.start import Limits
from barc_sim.lab.regrade import commands, states
from barc_sim.lab.regrade.recorded import attached, read
from barc_sim.lab.regrade.verdict import Verdict
from barc_sim.vehicle.bike_model import bikeFE
from barc_sim.vehicle.parameters import plant

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping
    from contextlib import AbstractContextManager
    from pathlib import Path

    from barc_sim.lab.check.code import JudgedCode, Next
    from barc_sim.lab.regrade.recorded import Recorded
    from barc_sim.vehicle.bike_model import Model

_OWN = 'barc_sim'


@dataclass(frozen=True)
class Judgement:
    """The verdicts on a bag."""

    bag: str
    states: int
    duration: float  #: [s]
    missed: int  #: deadlines
    claimed: Mapping[str, str]  #: by part, the code that the bag names
    changed: tuple[str, ...]  #: attached files that differ from those of the run
    relay: str | None  #: the name of the attached relay, which is not judged
    verdicts: tuple[Verdict, ...]

    @property
    def possible(self) -> bool:
        """Whether the bag could have come from the code that it names."""
        found = {(verdict.part, verdict.code): verdict.possible for verdict in self.verdicts}
        return not self.changed and all(found[claim] for claim in self.claimed.items())


def judge(
    path: Path,
    namespace: str | None = None,
    limits: Limits | None = None,
    *,
    sandbox: bool = True,
) -> Judgement:
    """Judge the bag at `path`; its attached code runs in a sandbox.

    Raises
    ------
    UserError
        if there is none, it lacks parameters, or this machine cannot confine its code.

    Examples
    --------
    >>> from barc_sim.bags.reader import newest
    >>> judge(newest('bags')).states
    1152
    """
    recorded = read(path, namespace)
    if recorded.files:
        check(sandbox=sandbox)
    try:
        opened = partial(attached, recorded, limits or Limits(), sandbox=sandbox)
        verdicts = tuple(_verdicts(recorded, opened))
    except (KeyError, TypeError, ValueError, OverflowError) as error:
        if isinstance(error, UserError):
            raise
        raise UserError(
            f'{str(path)!r} lacks parameters of its run ({error!r}): name the bag of a run of '
            'this version of barc_sim'
        ) from error
    parts = dict.fromkeys(verdict.part for verdict in verdicts)
    return Judgement(
        bag=str(path),
        states=len(recorded.log),
        duration=float(recorded.log.t[-1]),
        missed=int(recorded.log.missed.sum()),
        claimed={part: recorded.files.get(part, _OWN) for part in parts},
        changed=recorded.changed,
        relay=recorded.files.get('relay'),
        verdicts=verdicts,
    )


def _verdicts(
    recorded: Recorded, opened: Callable[[str], AbstractContextManager[JudgedCode]]
) -> Iterator[Verdict]:
    """Yield the verdict on barc_sim's model, then on the attached one; so on the controllers."""
    verdict, resets = _judge_states(recorded, bikeFE, _OWN)
    yield verdict
    if name := recorded.files.get('model'):
        try:
            with opened('model') as code:
                verdict, resets = _judge_states(recorded, _model(code), name)
        except UserError as error:
            verdict = Verdict('model', name, first=str(error))
        yield verdict
    if (values := recorded.controller) is None:
        return
    kind = values.get('controller_type', DEFAULT_TYPE)
    gains = {name: values[name] for name in TYPES[kind].gains}
    limit = values['acceleration_limit']
    show = partial(
        commands.judge,
        recorded.log,
        limit=limit,
        subtract_error=bool(values['subtract_error']),
        resets=resets,
    )
    yield show(partial(new_controller, kind, gains, limit), _OWN)
    if name := recorded.files.get('controller'):
        try:
            with opened('controller') as code:
                new = partial(code.new_pid, *gains.values(), limit=limit, fresh=False)
                verdict = show(new, name)
        except UserError as error:
            verdict = Verdict('controller', name, first=str(error))
        yield verdict


def _model(code: JudgedCode) -> Model:
    def step(*row: float, l_f: float, l_r: float, **_: float) -> Next:
        return code.bike_fe([Row(*row)], l_f=l_f, l_r=l_r)[0]

    return step


def _judge_states(recorded: Recorded, model: Model, code: str) -> tuple[Verdict, set[int]]:
    values = recorded.simulator
    return states.judge(
        recorded.log,
        partial(plant, values, model),
        code,
        placements=recorded.placements,
        braking=values['timeout_braking'] if values['command_timeout'] else None,
    )
