"""A user's files that are right: they compute what barc_sim's own do, to the last bit."""

from __future__ import annotations

import re
from dataclasses import replace
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any, NamedTuple

from barc_sim.lab.confined.process import JudgedCode
from barc_sim.lab.files import FILES, files_in, find_files
from barc_sim.lab.labs.hills import HILLS
from barc_sim.lab.user_code.code import UserCode
from barc_sim.lab.user_code.folder import BUDGET

if TYPE_CHECKING:
    from collections.abc import Collection

    from barc_sim.lab.grade.grade import Rubric
    from barc_sim.lab.judge import Finding, Settings

MODEL = """\
from math import atan, copysign, cos, sin, tan


def bikeFE(x, y, psi, v, a, d_f, a0, m, Ff, theta, ts, *, l_f=1.5, l_r=1.5, g=9.8):
    beta = atan(l_r / (l_f + l_r) * tan(d_f))
    push = -m * g * sin(theta)
    f_ext = push - copysign(a0 * v * v + Ff, v) if v else push
    v_next = v + ts * (a + f_ext / m)
    unresisted = v + ts * (a + push / m)
    if v > 0.0:
        v_next = max(v_next, min(unresisted, 0.0))
    elif v < 0.0:
        v_next = min(v_next, max(unresisted, 0.0))
    return [
        x + ts * v * cos(psi + beta),
        y + ts * v * sin(psi + beta),
        psi + ts * v / l_r * sin(beta),
        v_next,
    ]
"""

CONTROLLER = """\
class PID:
    def __init__(self, kp, ki, kd, output_min=-8.0, output_max=8.0):
        self.kp, self.ki, self.kd = kp, ki, kd
        self.output_min, self.output_max = output_min, output_max
        self.reset()

    def reset(self):
        self.proportional = self.integral = self.derivative = 0.0
        self.saturated = False
        self.previous = None

    def acc_calculate(self, speed_reference, speed_current, dt):
        error = speed_reference - speed_current
        self.proportional = self.kp * error
        increment = self.derivative = 0.0
        if self.previous is not None and dt > 0.0:
            increment = self.ki * error * dt
            self.derivative = -self.kd * (speed_current - self.previous) / dt
        self.previous = speed_current
        wanted = self.proportional + self.integral + increment + self.derivative
        output = min(max(wanted, self.output_min), self.output_max)
        self.saturated = wanted != output
        if (wanted - output) * increment <= 0.0:
            self.integral += increment
        return output


pid = PID(30, 200, 0.1)
"""


#: As on the board, without the limits of barc_sim's own.
PLAIN_MODEL = """\
from math import atan, cos, sin, tan

l_f = 1.5
l_r = 1.5
g = 9.8


def sign(v):
    return (v > 0) - (v < 0)


def bikeFE(x, y, psi, v, a, d_f, a0, m, Ff, theta, ts):
    beta = atan(l_r / (l_f + l_r) * tan(d_f))
    F_ext = -m * g * sin(theta) - (a0 * v**2 + Ff) * sign(v)
    x_next = x + ts * v * cos(psi + beta)
    y_next = y + ts * v * sin(psi + beta)
    psi_next = psi + ts * v / l_r * sin(beta)
    v_next = v + ts * (a + F_ext / m)
    return [x_next, y_next, psi_next, v_next]
"""

PLAIN_CONTROLLER = """\
class PID:
    def __init__(self, kp, ki, kd):
        self.kp = kp
        self.ki = ki
        self.kd = kd
        self.total = 0.0
        self.e_before = None

    def acc_calculate(self, speed_reference, speed_current):
        dt = 0.02
        e = speed_reference - speed_current
        self.total += e * dt
        change = 0.0 if self.e_before is None else e - self.e_before
        self.e_before = e
        P = self.kp * e
        I = self.ki * self.total
        D = self.kd * change / dt
        output = P + I + D
        return output


pid = PID(kp=30, ki=60, kd=0.1)
"""


LANE = """\
from math import asin, atan, atan2, copysign, cos, hypot, pi, sin, sqrt

L = 3.0
l_r = 1.5


def wrap(angle):
    return atan2(sin(angle), cos(angle))


def straight_errors(x, y, psi, x_0, y_0, psi_0):
    e_y = (y - y_0) * cos(psi_0) - (x - x_0) * sin(psi_0)
    e_psi = wrap(psi - psi_0)
    return [e_y, e_psi]


def arc_errors(x, y, psi, x_c, y_c, radius):
    side = copysign(1.0, radius)
    distance = hypot(x - x_c, y - y_c)
    heading = atan2(y - y_c, x - x_c) + side * pi / 2
    e_y = radius - side * distance
    e_psi = wrap(psi - heading)
    return [e_y, e_psi]


def steady(curvature):
    sine = l_r * curvature
    delta = atan(L * curvature / sqrt(1 - sine**2))
    e_psi = -asin(sine)
    return [delta, e_psi]


class Lane:
    def __init__(self):
        self.k_y = 0.22
        self.k_psi = 0.95

    def steer_calculate(self, e_y, e_psi, speed, curvature):
        k = curvature(0.0)
        delta, e_steady = steady(k)
        e = e_psi - e_steady
        steer = delta - self.k_y * e_y - self.k_psi * e
        return steer
"""


IDENTIFY = """\
import numpy as np

NAME = 'Ada Lovelace'
TS = 0.02


def command(t):
    if t < 7.0:
        return 2.0
    if t < 35.0:
        return 0.0
    k = int((t - 35.0) / 0.3 + 1e-9)
    return 2.0 * (1, -1, 1, 1, -1, -1, 1, -1)[k % 8]


def fit(t, v, a, delay):
    acted = np.interp(t - delay, np.append(t, t[-1] + TS), np.append(0.0, np.cumsum(a) * TS))
    acted[t < delay] = 0.0
    smooth = np.convolve(np.pad(v, 12, 'edge'), np.ones(25) / 25, 'valid')
    squares = np.append(0.0, np.cumsum(smooth**2)[:-1] * TS)
    moving = np.append(0.0, np.cumsum(acted > 0)[:-1] * TS)
    slopes = np.column_stack([-squares, -moving])
    found, *_ = np.linalg.lstsq(slopes, v - acted, rcond=None)
    return found, v - acted - slopes @ found, slopes


def estimate(t, v, a):
    t, v, a = np.array(t), np.array(v), np.array(a)
    delays = np.arange(0.0, 0.3, 0.002)
    costs = [np.sum(fit(t, v, a, d)[1] ** 2) for d in delays]
    k = int(np.clip(np.argmin(costs), 1, len(delays) - 2))
    p = np.polyfit(delays[k - 1 : k + 2] - delays[k], costs[k - 1 : k + 2], 2)
    delay = delays[k] - p[1] / (2 * p[0])
    (drag, friction), rest, slopes = fit(t, v, a, delay)
    ahead = (rest - fit(t, v, a, delay + 1e-3)[1]) / 1e-3
    slopes = np.column_stack([slopes, ahead])
    spread = np.sqrt(np.diag(np.linalg.inv(slopes.T @ slopes)) * np.mean(rest**2))
    half = 1.96 * spread
    return [drag, half[0], friction, half[1], delay, half[2]]
"""


RACELINE = """\
import numpy as np

L = 3.0
l_r = 1.5


def profile(curvatures, step):
    v2 = [min(144.0, 3.5 / abs(k)) if k else 144.0 for k in curvatures]
    n = len(v2)
    for k in range(2 * n):  # forwards
        v2[(k + 1) % n] = min(v2[(k + 1) % n], v2[k % n] + 4.0 * step)
    for k in range(2 * n, 0, -1):  # backwards
        v2[(k - 1) % n] = min(v2[(k - 1) % n], v2[k % n] + 4.0 * step)
    return [v**0.5 for v in v2]


def bounded(J, r, half):
    n = y = np.zeros(J.shape[1])
    t = 1.0
    H, g = J.T @ J, J.T @ r
    rate = 1.0 / np.linalg.norm(H, 2)
    for _ in range(3000):
        before, n = n, np.clip(y - rate * (H @ y + g), -half, half)
        t, last = (1 + np.sqrt(1 + 4 * t**2)) / 2, t
        y = n + (last - 1) / t * (n - before)
    return n


def line(x, y, psi, half):
    x, y, psi = np.array(x), np.array(y), np.array(psi)
    h = np.mean(np.hypot(np.diff(x), np.diff(y)))
    one = np.eye(len(x))
    second = (np.roll(one, 1, 1) - 2 * one + np.roll(one, -1, 1)) / h**2
    left_x, left_y = -np.sin(psi), np.cos(psi)
    bends = np.hstack([second @ x, second @ y])
    J = np.vstack([second * left_x, second * left_y])
    n = bounded(J, bends, half)
    return n


def predict(speed):
    d = 0.1 * speed
    b1 = d * l_r / L + d**2 / (2 * L)
    return [1.0, d, 0.0, 1.0, b1, d / L]


def program(e_y, e_psi, speed):
    a11, a12, a21, a22, b1, b2 = predict(speed)
    A, B, x = np.array([[a11, a12], [a21, a22]]), np.array([b1, b2]), np.array([e_y, e_psi])
    G = np.zeros((2, 10))
    H, g = 10.0 * np.eye(10), np.zeros(10)
    for k in range(10):
        x, G = A @ x, A @ G
        G[:, k] += B
        H += 2.0 * G.T @ G
        g += 2.0 * G.T @ x
    return np.append(H, g)
"""


class LocalCode(JudgedCode):
    """User code that is called in this process: nothing stops an endless loop."""

    def __init__(self, code: Any) -> None:  # noqa: ANN401 (a UserCode, or what has its names)
        super().__init__(Path())
        self._code = code

    def has(self, part: str) -> bool:
        """Return whether there is this part of `FILES`."""
        return part in self._code.paths

    def call(self, do: str, *arguments: Any) -> Any:  # noqa: ANN401 (JSON)
        """Return the result of a request."""
        found = getattr(self._code, do)
        return found(*arguments) if callable(found) else found


@cache
def judged_file(
    part: str, name: str, text: str, settings: Settings
) -> tuple[list[Finding], tuple[str, ...]]:
    """Return the findings on one file, called in this process, and what is tolerated in it.

    Each file is judged once, however many programs have it.
    """
    with TemporaryDirectory() as folder:
        path = Path(folder, name)
        path.write_text(text, encoding='utf-8')
        code = LocalCode(UserCode({part: path}, budget=None))
        own = HILLS.parts[part].labels
        found = [each for each in HILLS.judge(code, settings) if each.criterion in own]
        assert folder not in ''.join(each.message for each in found)
        return found, code.tolerated()


def load_folder(folder: Path, parts: Collection[str] = tuple(FILES), **options: Any) -> UserCode:  # noqa: ANN401
    """Load the files in a folder."""
    return UserCode(find_files(folder, parts), **options).load()


def load(path: Path, *, budget: float | None = BUDGET) -> UserCode:
    """Load the part that the file at `path` has by its name."""
    (part,) = (part for part, name in FILES.items() if name == path.name)
    return UserCode({part: path}, budget=budget).load()


def replaced(text: str, *pairs: tuple[str, str]) -> str:
    """Return `text` with each first string, which must be there, replaced by its second."""
    for old, new in pairs:
        assert old in text, old
        text = text.replace(old, new)
    return text


class Program(NamedTuple):
    """A folder, and what is expected of it."""

    points: float
    line: str  #: a part of the line that the remark names; empty: none is asked for
    sentence: str  #: a part of the remark
    changes: tuple[tuple[str, str], ...] = ()


def read_programs(table: str) -> dict[str, Program]:
    """Return the programs: name, points, line and sentence, then what is replaced by what."""
    programs: dict[str, Program] = {}
    for line in table.strip().splitlines():
        if not line.startswith(' '):
            name, points, place, sentence = line.split(' | ')
            programs[name] = Program(float(points), place.strip(), sentence)
        else:
            old, new = line.strip().replace('⏎', '\n').split(' -> ')
            changes = (*programs[name].changes, (old, new))
            programs[name] = programs[name]._replace(changes=changes)
    return programs


def points_of(
    program: Program, text: str, rubric: Rubric, folder: Path, criteria: Collection[str] = ()
) -> float:
    """Return the points of a lab's file, in these criteria, and check the remark and its line."""
    (name,) = rubric.lab.handout.files.values()
    (folder / name).write_text(text, encoding='utf-8')
    criteria = criteria or rubric.points
    code = LocalCode(UserCode(files_in(folder), budget=None))
    findings = rubric.lab.judge(code, replace(rubric.settings, criteria=criteria))
    assert [each.criterion for each in findings] == [*criteria]
    remarks = '\n'.join(each.message for each in findings)
    before, sentence, _ = remarks.partition(program.sentence)
    assert sentence, remarks
    if program.line:
        number = int(re.findall(rf'{name}, line (\d+)', before.splitlines()[-1])[-1])
        assert text.splitlines()[number - 1].strip().startswith(program.line)
    return sum(rubric.points_for(each) for each in findings if not each.open)
