"""The pinned runs: what each is called, its command line, its files and who drives it."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from user_files import user_text

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
#: As a student writes them: resistance by the sign of the speed; a limited integral; a relay that
#: always drives a curve.
_BIKE_MODEL = user_text('golden_model.py')
_CONTROLLER = user_text('golden_controller.py')
_RELAY = user_text('golden_relay.py')
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
