"""The lab of the hills: a model, a PID and a relay, and their criteria."""

from __future__ import annotations

from contextlib import suppress
from typing import TYPE_CHECKING

from barc_sim.control.speed import KD, KI, KP
from barc_sim.errors import UserError
from barc_sim.lab import handout
from barc_sim.lab.check.lab import Lab, Part
from barc_sim.lab.hills import controller, loop, model, relay
from barc_sim.lab.hills.code import HillsCode
from barc_sim.lab.user_code.source import ChosenGains

if TYPE_CHECKING:
    from collections.abc import Collection, Iterator

    from barc_sim.lab.check.code import Finding
    from barc_sim.lab.check.lab import Settings


def _judge_controller(
    code: HillsCode, settings: Settings, criteria: Collection[str]
) -> Iterator[Finding]:
    with suppress(UserError):
        code.new_pid(KP, KI, KD)
    gains = code.chosen_gains()
    findings = [*controller.judge_controller(code, settings.seed, criteria)]
    yield from findings
    if gains is None and controller.ignores_gains(code, settings.seed):
        gains = ChosenGains(KP, KI, KD, 'which have no effect')
    conditions = loop.Conditions(
        gains,
        settings.acceleration_limit,
        settings.thresholds,
        mended=controller.wrong_terms(findings),
    )
    if 'loop.lab_road' in criteria:
        yield loop.judge_lab_road(code, conditions)
    if 'loop.random_roads' in criteria:
        yield loop.judge_random_roads(code, conditions, settings.seed)


HILLS = Lab(
    handout.HILLS,
    HillsCode,
    {
        'model': Part(
            model.LABELS, lambda code, its, names: model.judge_model(code, its.seed, names)
        ),
        'controller': Part({**controller.LABELS, **loop.LABELS}, _judge_controller),
        'relay': Part(relay.LABELS, lambda code, *_: relay.judge_relay(code)),
    },
)
