"""User code from its text, and what is found of it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest
from user_files import LocalCode, load_folder

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

MODEL = """\
from math import *

L_F = L_R = 1.5


def sign(v):
    return (v > 0) - (v < 0)


def bikeFE(x, y, psi, v, a, d_f, a0, m, Ff, theta, ts, l_f=L_F, l_r=L_R):
    beta = atan(l_r / (l_f + l_r) * tan(d_f))
    drag = -a0 * v**2 * sign(v)
    friction = -Ff * sign(v)
    gravity = -m * 9.8 * sin(theta)
    F_ext = drag + friction + gravity
    x_next = x + ts * v * cos(psi + beta)
    y_next = y + ts * v * sin(psi + beta)
    psi_next = psi + ts * v / l_r * sin(beta)
    v_next = v + ts * (a + F_ext / m)
    return [x_next, y_next, psi_next, v_next]
"""

CONTROLLER = """\
class PID:
    def __init__(self, kp, ki, kd):
        self.kp = kp
        self.ki = ki
        self.kd = kd
        self.area = 0.0
        self.before = None

    def reset(self):
        self.area = 0.0
        self.before = None

    def acc_calculate(self, speed_reference, speed_current):
        dt = 0.02
        e = speed_reference - speed_current
        change = 0.0 if self.before is None else e - self.before
        area = self.area + e * dt
        out = self.kp * e + self.ki * area + self.kd * change / dt
        if abs(out) < 8.0:
            self.area = area
        self.before = e
        return max(-8.0, min(8.0, out))


pid = PID(30, 200, 0.1)
"""


@pytest.fixture
def lab(tmp_path: Path) -> Callable[..., LocalCode]:
    """Return what makes code of the text of a user's files."""

    def load(model: str | None = None, controller: str | None = None) -> LocalCode:
        for name, text in {'bike_model.py': model, 'controller.py': controller}.items():
            if text is not None:
                (tmp_path / name).write_text(text, encoding='utf-8')
        return LocalCode(load_folder(tmp_path, budget=None))

    return load


@pytest.fixture
def model() -> str:
    """Return a right `bike_model.py`, as a user may write it."""
    return MODEL


@pytest.fixture
def controller() -> str:
    """Return a right `controller.py`, as a user may write it."""
    return CONTROLLER
