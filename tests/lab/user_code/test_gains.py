"""The gains that a user has chosen, found in the text of a file."""

from __future__ import annotations

import ast

import pytest

from barc_sim.lab.user_code.source import find_gains

PID = 'class PID:\n    def __init__(self, kp=1, ki=1, kd=1): pass\n'
PLAIN = 'class PID:\n    def __init__(self, kp, ki, kd): pass\n'


@pytest.mark.parametrize(
    ('text', 'found'),
    [
        (PLAIN, None),
        (PID, None),
        (PID + 'def main():\n    c = PID(10, 0.5, 0.4)\n', (10, 0.5, 0.4, 'line 4')),
        (PID + 'def main():\n    c = PID(kd=-.4, kp=10, ki=1/2)\n', (10, 0.5, -0.4, 'line 4')),
        (PID + 'PID(1, 1, 1)\n', (1, 1, 1, 'line 3')),
        (PID + 'PID(1, 2, 3)\n# PID(4, 5, 6)\nPID(7, 8, 9)\n', (7, 8, 9, 'line 5')),
        (PID + 'PID(kp=5)\n', (5, 1, 1, 'line 3')),
        (PLAIN + 'PID(5)\nPID()\n', None),
        (
            'KP, KI = 3, 4\nKD = KP * 2\n' + PLAIN + 'PID(KP, KI, KD)\n',
            (3, 4, 6, 'line 5'),
        ),
        (PLAIN + 'def main():\n    a = 3\n    PID(a, a, 0)\n', (3, 3, 0, 'line 5')),
        ('K = 3\n' + PLAIN + 'PID(1, 2, 3)\nPID(K, K, K)\n', (3, 3, 3, 'line 5')),
        (PLAIN + 'PID(input(), 1, 2)\n', None),
        (PID.replace('kp=1', 'kp=4'), (4, 1, 1, 'defaults, line 2')),
        (
            'class PID:\n    def __init__(self, P=2, D=1, I=0, max=5): pass\n',
            (2, 0, 1, 'defaults, line 2'),
        ),
        ('class PID:\n    def __init__(self, P, D, I): pass\nPID(1, 2, 3)\n', (1, 3, 2, 'line 3')),
        (PLAIN + 'PID(*[1, 2, 3])\n', None),
        (PLAIN + 'PID(1e400, 1, 1)\n', None),
    ],
)
def test_gains_come_from_calls_constants_and_defaults_in_this_order(
    text: str, found: tuple[float, float, float, str] | None
) -> None:
    gains = find_gains(ast.parse(text), 'controller.py')
    if found is None:
        assert gains is None
    else:
        assert gains == (*found[:3], f'controller.py, {found[3]}')
