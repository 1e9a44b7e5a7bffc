"""Values of a user's that do harm when they are looked at: a sentence, no traceback, no hang."""

from __future__ import annotations

import inspect
import time
from typing import TYPE_CHECKING

import pytest
from user_files import load

from barc_sim.lab.user_code.adapters import UserController
from barc_sim.lab.user_code.source import UserCodeError

if TYPE_CHECKING:
    from pathlib import Path

ARGUMENTS = (0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 2000.0, 0.0, 0.0, 0.02)
MODEL = 'def bikeFE(x, y, psi, v, a, d_f, a0, m, Ff, theta, ts):\n    return '
CONTROLLER = """
class PID:
    def __init__(self, kp=1.0, ki=1.0, kd=1.0):
        pass
    def acc_calculate(self, speed_reference, speed_current):
        return 1.0
"""
FOREVER = '[0 for _ in iter(int, 1)]'
#: By name: what is before the model, and what the model returns.
MODELS = {
    'a great number': ('', '[10**5000, y, psi, v]'),
    'only great numbers': ('', '10**5000'),
    'no ravel': ('class R(list):\n def ravel(self): raise RuntimeError', 'R([x, y, psi, v])'),
    'endless ravel': ('class R:\n def ravel(self):\n  while True: yield 1.0', 'R()'),
    'counting ravel': (
        'import itertools\nclass R:\n def ravel(self): return itertools.count()',
        'R()',
    ),
    'endless list': (
        f'class R(list):\n def __len__(self): return 4\n def __iter__(self): {FOREVER}',
        'R()',
    ),
    'endless number': (f'class R:\n def __float__(self): {FOREVER}', '[R(), y, psi, v]'),
    'no class': ('class R:\n def __getattribute__(self, name): raise RuntimeError', 'R()'),
}


@pytest.mark.parametrize('name', MODELS)
def test_what_a_model_returns_is_looked_at_with_care(tmp_path: Path, name: str) -> None:
    before, returned = MODELS[name]
    file = tmp_path / 'bike_model.py'
    file.write_text(f'{before}\n{MODEL}{returned}\n')
    model = load(file, budget=0.2).model
    assert model
    began = time.monotonic()
    with pytest.raises(UserCodeError, match=r'returned .*; expected four finite numbers'):
        model(*ARGUMENTS)
    assert time.monotonic() - began < 5.0


@pytest.mark.parametrize('fault', ['raise RuntimeError(name)', FOREVER])
@pytest.mark.parametrize('method', ['__getattr__', '__getattribute__'])
def test_a_controller_that_refuses_to_be_looked_at(tmp_path: Path, method: str, fault: str) -> None:
    file = tmp_path / 'controller.py'
    file.write_text(f'{CONTROLLER}    def {method}(self, name):\n        {fault}\n')
    code = load(file, budget=0.2)
    if method == '__getattribute__':
        with pytest.raises(UserCodeError, match='expected a function, got None'):
            UserController(code)
    else:  # only what it does not have
        assert UserController(code).acc_calculate(8.0, 0.0, 0.02) == 1.0


def test_a_replaced_signature_matters_to_nobody(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(inspect, 'signature', inspect.signature)  # put back afterwards
    file = tmp_path / 'controller.py'
    file.write_text(f'import inspect\ninspect.signature = None\n{CONTROLLER}')
    controller = UserController(load(file))
    assert controller.acc_calculate(8.0, 0.0, 0.02) == 1.0
