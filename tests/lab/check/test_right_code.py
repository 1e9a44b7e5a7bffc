"""Right code gets full marks, in any of its forms; the same every time."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest
from user_files import CONTROLLER, MODEL, replaced, user_text

from barc_sim.lab.confined.process import JudgedCode, ProcessLimits
from barc_sim.lab.judge import Functions, Settings
from barc_sim.lab.labs.hills import HILLS
from barc_sim.lab.labs.relay import LABELS as RELAY
from barc_sim.lab.law import Law, LawSituation

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from user_files import LocalCode

    from barc_sim.lab.judge import Finding

    Lab = Callable[..., LocalCode]

NUMPY_MODEL = user_text('numpy_model.py')

MODELS = {
    'list': ('', ''),
    'tuple': ('[x_next, y_next, psi_next, v_next]', '(x_next, y_next, psi_next, v_next)'),
    'no lengths': (', l_f=l_f, l_r=l_r', ', *_'),
    'another form': ('/ l_r * sin(beta)', '* cos(beta) / (l_f + l_r) * tan(d_f)'),
    'sign of zero is plus': ('(v > 0) - (v < 0)', '1 if v >= 0 else -1'),
    'an option': ('l_r=l_r)', 'l_r=l_r, g=9.8)'),
    'a print': ('    beta =', '    print(v)\n    beta ='),
}

ON_MEASUREMENT = user_text('pid_on_measurement.py')

CONTROLLERS = {
    'plain': ('', ''),
    'dt as an argument': ('speed_current):\n        dt = 0.02', 'speed_current, dt):'),
    'first error counts from zero': ('0.0 if self.e_before is None', 'e if self.e_before is None'),
    'summed after use': ('self.ki * total', 'self.ki * self.total'),
    'trapezoids': (
        'total = self.total + e * dt',
        'total = self.total + dt * (e + (self.e_before or 0.0)) / 2',
    ),
    'limited integral': (
        'if abs(output) < 8.0:\n            self.total = total',
        'if self.ki:\n            self.total = max(-8 / self.ki, min(8 / self.ki, total))',
    ),
    'filtered derivative': (
        'D = self.kd * change',
        "D = self.D = 0.6 * getattr(self, 'D', 0.0) + 0.4 * self.kd * change",
    ),
    'derivative of second order': (
        'D = self.kd * change',
        'c = self.c = [*getattr(self, "c", [0.0]), change]; D = self.kd / 2 * (3 * c[-1] - c[-2])',
    ),
    'slope of five calls': (
        'D = self.kd * change',
        'self.e = [*getattr(self, "e", []), e]; D = self.kd * (e - self.e[-6:][0]) / 5',
    ),
    "the computer's clock": (
        'dt = 0.02',
        'import time; before = getattr(self, "t", 0.0); self.t = time.time(); dt = self.t - before',
    ),
    'own limits': ('return max(-8.0, min(8.0, output))', 'return max(-8.5, min(8.5, output))'),
    'an array': (
        'return max(-8.0, min(8.0, output))',
        'import numpy\n        return numpy.array([output]).clip(-8, 8)',
    ),
}


def messages(findings: list[Finding]) -> dict[str, str]:
    judged = [finding for finding in findings if finding.criterion not in RELAY]
    return {finding.criterion: finding.message for finding in judged if finding.score != 1.0}


def test_barc_sims_own_code_gets_full_marks(lab: Lab) -> None:
    findings = HILLS.judge(lab(MODEL, CONTROLLER))
    assert messages(findings) == {}
    assert tuple(finding.criterion for finding in findings) == tuple(HILLS.labels)


@pytest.mark.parametrize('name', [*MODELS, 'arrays'])
def test_a_right_model_gets_full_marks(lab: Lab, model: str, name: str) -> None:
    text = NUMPY_MODEL if name == 'arrays' else replaced(model, MODELS[name])
    assert messages(HILLS.judge(lab(text))[:4]) == {}


def test_no_seed_makes_right_code_wrong(lab: Lab, model: str, controller: str) -> None:
    assert messages(HILLS.judge(lab(model, controller), Settings(seed=1))) == {}


@pytest.mark.parametrize('name', [*CONTROLLERS, 'on measurement'])
def test_a_right_controller_gets_full_marks(lab: Lab, controller: str, name: str) -> None:
    changed = (
        ON_MEASUREMENT if name == 'on measurement' else replaced(controller, CONTROLLERS[name])
    )
    assert messages(HILLS.judge(lab(controller=changed))[4:]) == {}


def test_the_same_seed_gives_the_same_findings(lab: Lab, model: str, controller: str) -> None:
    code = lab(model.replace('sin(theta)', 'sin(theta)**3'), controller.replace('0.02', '0.03'))
    names = ('model.v', 'pid.integral')
    first, again, other = (HILLS.judge(code, Settings(seed=k, criteria=names)) for k in (3, 3, 4))
    assert first == again != other


def test_a_missing_file_is_skipped_and_gets_no_points(lab: Lab, model: str) -> None:
    findings = HILLS.judge(lab(model))
    assert [finding.skipped for finding in findings] == [False] * 4 + [True] * 9
    assert {finding.message for finding in findings[4:8]} == {'there is no controller.py'}
    assert {finding.message for finding in findings[8:]} == {'there is no relay.py'}
    assert {finding.score for finding in findings[4:]} == {0.0}


def test_a_function_that_returns_one_number_is_judged(tmp_path: Path) -> None:
    (tmp_path / 'identify.py').write_text('def command(t):\n    return 2.0 * t\n')
    situation = LawSituation('any time', ['command'], {'t': (0.0, 60.0)})
    law = Law({'command': '2.0 * t'}, (), {'command': (situation,)})
    functions = Functions(
        law, results={'command': ('command',)}, criteria={'command': 'stop.command'}, count=10
    )

    with JudgedCode(tmp_path, ProcessLimits(confined=False)) as code:
        findings, _ = functions.judge(code, seed=0)
    assert [each.message for each in findings] == ['right in all 10 cases']
