"""A class: how long `barc grade` takes for it, confined, with reports and figures.

The submissions are right, in the form of the lab: such take the longest.
"""

from __future__ import annotations

import csv
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import TYPE_CHECKING

from barc_sim.cli.parser import whole
from barc_sim.errors import UserError

if TYPE_CHECKING:
    import argparse

_FILES = {
    'bike_model.py': """\
from numpy import array, arctan, cos, sin, tan

def bikeFE(x, y, psi, v, a, d_f, a0, m, Ff, theta, ts):
    l_f = l_r = 1.5
    beta = arctan(l_r / (l_f + l_r) * tan(d_f))
    F_ext = -m * 9.8 * sin(theta) - a0 * v**2 - Ff
    rate = array([v * cos(psi + beta), v * sin(psi + beta), v / l_r * sin(beta), a + F_ext / m])
    return array([x, y, psi, v]) + ts * rate
""",
    'controller.py': """\
class PID:
    def __init__(self, kp, ki, kd):
        self.kp, self.ki, self.kd = kp, ki, kd
        self.sum = self.last = 0

    def acc_calculate(self, speed_reference, speed_current):
        e = speed_reference - speed_current
        self.sum += e
        change, self.last = e - self.last, e
        return self.kp * e + self.ki * self.sum + self.kd * change

pid = PID(kp={kp}, ki=0.5, kd=0.4)
""",
    'relay.py': """\
def relay(linear_x, angular_z):
    return [2.0 * linear_x, 0.3 * angular_z]
""",
}
Found = dict[str, float]
QUICK = ('--count', '2')


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    cores = len(os.sched_getaffinity(0))
    parser.add_argument('--count', type=whole(1), default=200, help='submissions (200)')
    parser.add_argument('--jobs', type=whole(1), default=cores, help=f'at once ({cores})')


def measure(options: argparse.Namespace) -> Found:
    """Return the time of the class."""
    with tempfile.TemporaryDirectory(prefix='barc_sim_') as folder:
        for number in range(options.count):
            submission = Path(folder, 'class', f'student_{number:03}')
            submission.mkdir(parents=True)
            for name, text in _FILES.items():
                own = text.replace('{kp}', str(10 + number / 10))
                (submission / name).write_text(own, encoding='utf-8')
        command = ('-m', 'barc_sim', 'grade', 'class', '--jobs', str(options.jobs))
        began = time.perf_counter()
        done = subprocess.run(  # noqa: S603 (our own)
            [sys.executable, *command], cwd=folder, stdout=subprocess.PIPE, text=True, check=False
        )
        taken = time.perf_counter() - began
        if done.returncode:
            raise UserError(f'grade failed: {done.stdout}')
        with Path(folder, 'grades', 'class.csv').open(encoding='utf-8') as file:
            scores = [float(row['score']) for row in csv.DictReader(file)]
    return {'submissions': len(scores), 'jobs': options.jobs, 's': taken, 'least': min(scores)}


def report(found: Found) -> str:
    """Return the time in all, and of one submission."""
    return (
        f'{found["submissions"]:g} submissions, {found["jobs"]:g} at once: {found["s"]:.1f} s, '
        f'{found["s"] / found["submissions"]:.2f} s each; least score {found["least"]:g}'
    )
