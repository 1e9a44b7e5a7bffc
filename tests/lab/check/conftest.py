"""User code from its text, and what is found of it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest
from user_files import PLAIN_CONTROLLER, PLAIN_MODEL, LocalCode, load_folder, replaced

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

LIMITED = """\
if abs(output) < 8.0:
            self.total = total
        return max(-8.0, min(8.0, output))"""
RESET = """\
    def reset(self):
        self.total = 0.0
        self.e_before = None

"""


@pytest.fixture
def lab(tmp_path: Path) -> Callable[..., LocalCode]:
    """Return what makes code of the text of a user's files."""

    def load(model: str | None = None, controller: str | None = None) -> LocalCode:
        for name, text in {'bike_model.py': model, 'controller.py': controller}.items():
            if text is not None:
                (tmp_path / name).write_text(text, encoding='utf-8')
        return LocalCode(load_folder(tmp_path, is_judged=True))

    return load


@pytest.fixture
def model() -> str:
    """Return a right `bike_model.py` that takes the lengths."""
    return replaced(PLAIN_MODEL, (', ts):', ', ts, l_f=l_f, l_r=l_r):'))


@pytest.fixture
def controller() -> str:
    """Return a right `controller.py` with a limit and a reset."""
    return replaced(
        PLAIN_CONTROLLER,
        ('    def acc_calculate', f'{RESET}    def acc_calculate'),
        ('self.total += e * dt', 'total = self.total + e * dt'),
        ('self.ki * self.total', 'self.ki * total'),
        (
            'return output',
            LIMITED,
        ),
        ('kp=30, ki=60, kd=0.1', '30, 200, 0.1'),
    )
