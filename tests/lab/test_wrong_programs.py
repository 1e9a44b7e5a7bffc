"""Wrong and unusual programs: what a fair instructor says, of which line, and the points.

The table was written before the code that is tested. A program is a right one, and what is
replaced in it. Those of relays, and of nodes that read the keys themselves, are in
`grade/test_relay.py`.
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

import pytest
from user_files import PLAIN_CONTROLLER, PLAIN_MODEL, Program, judged_file, read_programs, replaced

from barc_sim.lab.confined.process import ProcessLimits
from barc_sim.lab.files import FILES
from barc_sim.lab.grade.grade import load
from barc_sim.lab.labs.hills import HILLS

if TYPE_CHECKING:
    from pathlib import Path

    from barc_sim.lab.judge import Finding


PROGRAMS = read_programs("""
right | 100 |  | right in all 2,750 cases
g of 9.81 | 98 | g = 9.81 | g is 9.81: the lab has 9.8
    g = 9.8 -> g = 9.81
gravity's sign | 93 | F_ext = | gravity speeds the car up uphill
    -m * g -> m * g
no gravity | 91 | F_ext = | gravity is missing: F_ext includes -m * g * sin(theta)
    -m * g * sin(theta) - (a0 -> -(a0
theta once more | 92 | theta = | theta is already in radians
    F_ext = -> theta = theta * 3.141592653589793 / 180⏎    F_ext =
a power of sin | 94 | v_next = | v_next is wrong (uphill, downhill,
    sin(theta) -> sin(theta)**3
no bracket in v | 92 | v_next = | F_ext / m is not multiplied by ts: are the brackets missing
    (a + F_ext / m) -> a + F_ext / m
beta's sign | 95 | beta = | is the sign of beta right?
    beta = atan -> beta = -atan
no ratio | 94 | beta = | beta is as large as d_f
    atan(l_r / (l_f + l_r) * tan(d_f)) -> d_f
a division by v beside a wrong x | 96 | F_ext = | line 14: bikeFE(x=
    * sign(v) -> * abs(v) / v
    cos(psi + beta) -> sin(psi + beta)
an import that is missing | 50 | x_next = | is from math import cos missing?
    import atan, cos, -> import atan,
numpy's sign that is missing | 50 | F_ext = | is from numpy import sign missing?
    def sign(v) -> def signum(v)
np that is missing | 50 | F_ext = | is import numpy as np missing?
    * sign(v) -> * np.sign(v)
a misspelled name | 50 | F_ext = | did you mean theta?
    sin(theta) -> sin(thetha)
a power by ^ | 50 | F_ext = | a power is ** in Python
    v**2 -> v^2
a beta of its own | 95 | x_next = | x_next is wrong (
    l_r / (l_f + l_r) -> 0.7
beta in degrees | 92 | beta = | beta is in degrees
    * tan(d_f)) -> * tan(d_f)) * 57.29577951308232
sin and cos swapped | 93 | x_next = | sin and cos are swapped
    cos(psi + beta) -> sinus
    sin(psi + beta) -> cos(psi + beta)
    sinus -> sin(psi + beta)
v first | 96 | x_next = | the new v is used for x, y or psi
    x_next = -> v = v + ts * (a + F_ext / m)⏎    x_next =
    v_next = v + ts * (a + F_ext / m) -> v_next = v
no Euler step | 86 | x_next = | the rate of change is returned in place of x_next
    x_next = x + ts * -> x_next =
    y_next = y + ts * -> y_next =
    psi_next = psi + ts * -> psi_next =
    v_next = v + ts * -> v_next =
no ts | 93 | x_next = | ts is missing in x_next
    ts * v -> v
    ts * (a -> (a
0.01 for ts | 94 | ts = 0.01 | ts is always 0.01: use the argument
    beta = -> ts = 0.01⏎    beta =
order of the result | 88 | return [ | v_next is returned in place of psi_next
    psi_next, v_next] -> v_next, psi_next]
rounded to six digits | 98 | return [ | the results are rounded: return them as they are
    [x_next, y_next, psi_next, v_next] -> [round(z, 6) for z in (x_next, y_next, psi_next, v_next)]
single precision | 98 | return numpy | the results are rounded to single precision
    return [ -> import numpy⏎    return numpy.float32([
    v_next]⏎ -> v_next])⏎
an assertion uphill | 94 | assert theta | AssertionError
    beta = -> assert theta < 0.2⏎    beta =
the template's model | 50 | raise | bikeFE is not written yet (TODO)
    beta = -> raise NotImplementedError⏎    beta =
reversed error | 92 | e = | the error has the wrong sign: it is speed_reference - speed_current
    speed_reference - speed_current -> speed_current - speed_reference
abs of the error | 92 | e = | the error has lost its sign: remove the abs
    speed_reference - speed_current -> abs(speed_reference - speed_current)
an own error with a factor | 100 |  | right in all 240 outputs
    speed_reference - speed_current -> 2 * (speed_reference - speed_current)
P only | 84 | return output | I is always 0
    P + I + D -> P
    kp=30, ki=60, kd=0.1 -> kp=30, ki=0, kd=0
I without a sum | 94 | I = | I has no memory
    self.total += e * dt -> self.total = e * dt
I with the wrong sign | 95 | output = | I has the wrong sign
    P + I + D -> P - I + D
a clamped sum | 100 |  | right in all 240 outputs
    self.total += e * dt -> self.total = max(-0.1, min(0.1, self.total + e * dt))
the sum differentiated | 95 | D = | D is kd * e, not kd * (e - e_before)
    change = 0.0 if -> change = e * dt if True else 0.0 if
D without memory | 95 | D = | D is kd * e
    self.e_before = e⏎ -> self.e_before = 0.0⏎
D after the error is stored | 92 | return output | replaced only after D has used it?
    self.total += -> self.e_before = e⏎        self.total +=
D adds | 95 | D = | D adds e_before, but must subtract it
    e - self.e_before -> e + self.e_before
kp in all terms | 94 |  | kp multiplies
    P + I + D -> P + self.kp * (I + D)
whole numbers | 87 | return int | the outputs are whole numbers
    return output -> return int(output)
rounded outputs | 96 | return round | the outputs are rounded: return them as they are
    return output -> return round(output, 3)
own gains | 88 |  | the gains that PID gets have no effect
    = kp -> = 30
    = ki -> = 60
    = kd -> = 0.1
dt forgotten in the sum | 100 |  | I has no dt
    e * dt -> e
no gains chosen | 74 |  | controller.py chooses no gains
    pid = PID(kp=30, ki=60, kd=0.1) -> pass
a missing colon | 50 | class PID | syntax error
    class PID: -> class PID
a name without self | 50 | P = | did you mean self.kp?
    self.kp * e -> kp * e
a sum without self | 50 | total += | did you mean self.total?
    self.total += -> total +=
a local name that is not set | 50 | other += | or keep it between calls as self.other
    self.total += -> other +=
a misspelled attribute | 50 | I = | did you mean self.total?
    * self.total -> * self.totla
an attribute that is not made | 50 | self.total += | is self.total set in __init__?
    self.total = 0.0 -> pass
a value that is None at first | 50 | change = | is a value None at the first call
    e - self.e_before -> e - None
a method without self | 50 | def acc | is self missing as its first argument?
    acc_calculate(self, -> acc_calculate(
__init__ misspelled | 50 | pid = | is __init__ written with two underscores
    __init__ -> _init_
no return | 50 | def acc | is its return missing?
    return output -> pass
a limit of 2 | 72 |  | at its limit of 2 m/s²
    return output -> return max(-2.0, min(2.0, output))
it swings | 75 |  | the speed swings
    kp=30, ki=60, kd=0.1 -> kp=0.3, ki=60, kd=0
a weak kp | 82 |  | m/s too fast at the end
    kp=30, ki=60, kd=0.1 -> kp=2, ki=0.2, kd=0
all gains are 0 | 74 |  | the commands do not move it
    kp=30, ki=60, kd=0.1 -> kp=0, ki=0, kd=0
both files | 86 | F_ext = | gravity is missing
    -m * g * sin(theta) - (a0 -> -(a0
    speed_reference - speed_current -> speed_current - speed_reference
""")

LAB = load('lab')


def texts_of(program: Program) -> dict[str, str]:
    """Return the files of a program, by part."""
    texts = [PLAIN_MODEL, PLAIN_CONTROLLER]
    for old, new in program.changes:
        part = 0 if old in texts[0] else 1
        texts[part] = replaced(texts[part], (old, new))
    return dict(zip(('model', 'controller'), texts, strict=True))


def judged(texts: dict[str, str]) -> dict[str, Finding]:
    """Return the findings on files, by part, by the rubric `lab`."""
    found = [judged_file(part, FILES[part], text, LAB.settings)[0] for part, text in texts.items()]
    return {each.criterion: each for findings in found for each in findings}


def points(findings: dict[str, Finding]) -> float:
    return sum(LAB.points_for(each) for each in findings.values() if not each.skipped)


def remarks(findings: dict[str, Finding]) -> str:
    return '\n'.join(each.message for each in findings.values())


@pytest.mark.parametrize('name', PROGRAMS)
def test_points_sentence_and_line(name: str) -> None:
    program = PROGRAMS[name]
    texts = texts_of(program)
    findings = judged(texts)
    assert program.sentence in remarks(findings)
    assert points(findings) == pytest.approx(program.points, abs=5.0)
    if program.line:
        remark = next(m for m in remarks(findings).splitlines() if program.sentence in m)
        file, number = re.findall(r'(\w+\.py), line (\d+)', remark)[0]
        (part,) = (part for part, name in FILES.items() if name == file)
        line = texts[part].splitlines()[int(number) - 1]
        assert line.strip().startswith(program.line)


def test_a_multiple_of_the_error_in_place_of_d_makes_no_weak_loop_stronger() -> None:
    weak = replaced(PLAIN_CONTROLLER, ('kp=30, ki=60, kd=0.1', 'kp=2, ki=0.2, kd=0.5'))
    wrong = replaced(weak, ('self.e_before = e\n', 'self.e_before = 0.0\n'))
    alone, more = (judged({'controller': text}) for text in (weak, wrong))
    drives = [findings['loop.lab_road'].score for findings in (alone, more)]
    assert drives[0] == pytest.approx(drives[1], abs=0.01)
    assert drives[0] < 0.5
    assert more['pid.derivative'].score == 0.0


@pytest.mark.parametrize(
    ('text', 'words'),
    [
        (PLAIN_CONTROLLER.replace('dt = 0.02', 'while True: pass'), 'is there an endless loop?'),
        (PLAIN_CONTROLLER.replace('dt = 0.02', 'import os; os._exit(1)'), 'ended itself'),
    ],
    ids=['endless loop', 'exit'],
)
def test_what_keeps_a_controller_from_running_is_the_remark(
    tmp_path: Path, text: str, words: str
) -> None:
    (tmp_path / 'bike_model.py').write_text(PLAIN_MODEL, encoding='utf-8')
    (tmp_path / 'controller.py').write_text(text, encoding='utf-8')
    report = HILLS.judge_folder(tmp_path, LAB.settings, ProcessLimits(call=0.2, confined=False))
    findings = {each.criterion: each for each in report.findings if not each.skipped}
    assert points(findings) == 50.0  # of the model
    for criterion in ('pid.proportional', 'pid.integral', 'pid.derivative', 'loop.lab_road'):
        assert words in findings[criterion].message
