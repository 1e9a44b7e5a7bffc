"""The pinned runs: what each is called, its command line, its files and who drives it."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from collections.abc import Mapping

_ROAD = """\
# Starts before the car, and has stretches of unequal length.
start_m,grade_deg
-5,2.5
7.5,-4
31,12.25
33,0.125
70,-20
"""
#: Level where the car starts: it does not move before the driver wants it to.
_LEVEL_START = 'start_m,grade_deg\n0,0\n4,6.5\n12.5,-9\n'
_BIKE_MODEL = '''\
"""The lab's model as a student writes it: resistance by the sign of the speed, nothing more."""

from math import atan, cos, sin, tan

L_F = L_R = 1.5
G = 9.8


def bikeFE(x, y, psi, v, a, d_f, a0, m, Ff, theta, ts):
    beta = atan(L_R / (L_F + L_R) * tan(d_f))
    sign = (v > 0) - (v < 0)
    f_ext = -m * G * sin(theta) - (a0 * v**2 + Ff) * sign
    x_next = x + ts * v * cos(psi + beta)
    y_next = y + ts * v * sin(psi + beta)
    psi_next = psi + ts * v / L_R * sin(beta)
    v_next = v + ts * (a + f_ext / m)
    return [x_next, y_next, psi_next, v_next]
'''
_CONTROLLER = '''\
"""A PID as a student writes it: a limited integral, and the derivative of the error."""


class PID:
    def __init__(self, kp, ki, kd):
        self.kp = kp
        self.ki = ki
        self.kd = kd
        self.sum = 0.0
        self.last = None

    def acc_calculate(self, speed_reference, speed_current, dt):
        error = speed_reference - speed_current
        self.sum = max(-0.05, min(self.sum + error * dt, 0.05))
        change = 0.0 if self.last is None else (error - self.last) / dt
        self.last = error
        self.proportional = self.kp * error
        self.integral = self.ki * self.sum
        return self.proportional + self.integral + self.kd * change
'''
_RELAY = '''\
"""A relay that always drives a curve, whatever the driver wants."""


def relay(linear_x, angular_z):
    return [2.5, 0.0625]
'''
_NOISE = {
    'noise_s': 0.1,
    'noise_ey': 0.05,
    'noise_epsi': 0.01,
    'noise_v_x': 0.05,
    'noise_v_y': 0.02,
    'noise_psi_dot': 0.01,
}


class Scenario(NamedTuple):
    """A run of `acc` or `teleop`, made by the command line that a user would type."""

    options: str = ''  #: of `acc` or `teleop`
    parameters: Mapping[str, object] = {}  #: of ROS, by name; `node:name` for those of one node
    remap: str = ''  #: a rule of ROS's
    mode: str = 'acc'
    files: Mapping[str, str] = {}  #: text by path, in the folder of the run
    #: Drives the run from outside: 'steering' answers every state, 'throttle' publishes `cmd_vel`.
    driver: str = ''

    def arguments(self) -> list[str]:
        """Return the words that follow `barc`."""
        ros = [word for item in self.parameters.items() for word in ('-p', '{}:={}'.format(*item))]
        if self.remap:
            ros += ['-r', self.remap]
        return [self.mode, *self.options.split(), *(['--ros-args', *ros] if ros else [])]


#: As fast as it goes: each state waits for its command, and each command for its state.
_LOCK_STEP = '--realtime-factor max'
_TELEOP = '--view none --realtime-factor 10'

SCENARIOS = {
    'default': Scenario(_LOCK_STEP),
    'noise': Scenario(_LOCK_STEP, _NOISE),
    'road_file': Scenario(f'{_LOCK_STEP} --road hills.csv', files={'hills.csv': _ROAD}),
    'flat_in_a_namespace': Scenario(f'{_LOCK_STEP} --road flat --distance 60', remap='__ns:=/lane'),
    'ten_cars': Scenario(f'{_LOCK_STEP} --cars 10 --distance 60', _NOISE),
    'user_code': Scenario(
        f'{_LOCK_STEP} --lab lab',
        # User code has no limit unless one is given.
        {'controller:acceleration_limit': 8.0},
        files={'lab/bike_model.py': _BIKE_MODEL, 'lab/controller.py': _CONTROLLER},
    ),
    'steered_dynamic_rk4': Scenario(
        f'{_LOCK_STEP} --distance 90 --no-controller --dynamics dynamic --integrator rk4',
        {'front_stiffness': 90000.0, 'yaw_inertia': 3200.0},
        driver='steering',
    ),
    'teleop': Scenario(
        f'{_TELEOP} --road hills.csv',
        {'relay:stale_after': 60.0},
        mode='teleop',
        files={'hills.csv': _LEVEL_START},
        driver='throttle',
    ),
    'teleop_user_code': Scenario(
        f'{_TELEOP} --relay relay.py --dynamics dynamic --integrator rk4',
        mode='teleop',
        files={'relay.py': _RELAY},
        driver='throttle',
    ),
}
