"""The BARC vehicle simulator for ROS 2: model, controller, recorder, plots and replays.

Every exported name works without ROS, and is imported at its first use, so that a command's
`--help` stays quick.

A closed loop and its plot::

    >>> from barc_sim import simulate
    >>> log = simulate(kp=10.0, ki=20.0, kd=0.0)
    >>> figure = log.plot()

Another road, which may also be 'flat' or the path of a CSV file::

    >>> from barc_sim import Road, simulate
    >>> hill = Road(starts=[0.0, 50.0, 100.0], grades_deg=[0.0, 5.0, 0.0])
    >>> simulate(road=hill, distance=120.0)
    <Log: 777 states, 15.52 s, 120.1 m, speed error 1.189 m/s RMS>

A sweep over 200 gains::

    >>> from barc_sim import sweep
    >>> found = sweep(kp=[0.3 * n for n in range(1, 201)], ki=20.0, kd=0.0)
    >>> print(f'best kp {found.kp[found.rms_error.argmin()]:.1f}')
    best kp 60.0

A bag as a DataFrame::

    >>> from barc_sim import read_bag
    >>> frame = read_bag('bags/2026-11-21_12-00-00').to_frame()
    >>> average_speed = frame.v_x.mean()

Your own controller::

    >>> class Proportional:
    ...     def acc_calculate(self, speed_reference, speed_current):
    ...         return 10.0 * (speed_reference - speed_current)
    >>> log = simulate(controller=Proportional())

Laps of a track, in place of the road: ``oval``, ``circle``, ``figure-eight``, or a CSV file::

    >>> from barc_sim import LaneLQR, lap
    >>> log = lap(LaneLQR(), 'L', speed=6.0, laps=2)
    >>> print(f'{log.best:.2f} s')
    28.97 s

Where to look: the equations of the vehicle are in `vehicle/bike_model.py` (`resistance`, `step`),
those of the PID in `control/speed.py` (`pid`). `Stepper.decide` in `simulation/stepper.py` decides
whether a run missed a deadline; for a bag without a record of it, `join` in `bags/samples.py` does.
`lab/labs/` judges a user's model and PID; `bike.txt` and `pid.txt` list the mistakes that it names.

The way of a state, from the model to the plot of a run with ROS:

1. `commands/drive.py` chooses the engine, and a module of `runs/` makes the nodes of the run.
2. `nodes/start_gate.py` waits for a controller. Then the `Stepper` of `simulation/stepper.py` has
   the first state published: there is none before.
3. `Plant.observe` in `vehicle/plant.py` measures the state.
4. `nodes/simulator.py` (`publish_state`) publishes it: `fill` of `ros/conversions.py` copies the
   record into a message.
5. `nodes/controller.py` passes it to `CruiseControl` in `control/cruise_control.py`, whose pilot
   (`control/pilots.py`) answers with a command.
6. `Stepper.take_command` stores the command. The step follows at once or at the deadline.
7. The simulator publishes which command is applied (`publish_applied`).
   `Plant.advance` makes the step: actuators, force, then the bicycle of `vehicle/bicycles.py` on
   its road or track. The next state follows at 3.
8. `nodes/recorder.py` takes all messages, and `bags/writer.py` writes them to the bag.
9. `bags/reader.py` reads them, `bags/decoders.py` decodes them, and `bags/samples.py` (`join`)
   makes the `Log` of `simulation/log.py`.
10. `commands/figures.py`, the command `barc plot`, and the function `plot` call
    `figures/run_figures.py`, which draws the log.

`simulate` needs no messages: the loops that `simulation/__init__.py` lists make the same log.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from barc_sim.bags.reader import read as read_bag
    from barc_sim.control.lane import LaneLQR, PurePursuit, Stanley, speed_profile
    from barc_sim.control.mpc import MPC, SpeedMPC
    from barc_sim.control.planning import racing_line
    from barc_sim.control.speed import LQR, PID
    from barc_sim.figures.run_figures import plot
    from barc_sim.simulation.closed_loop import lap, simulate
    from barc_sim.simulation.log import Log
    from barc_sim.simulation.metrics import summary
    from barc_sim.simulation.scenario import Scenario
    from barc_sim.tuning.identification import identify
    from barc_sim.tuning.sweep import sweep, sweep_to_parquet
    from barc_sim.vehicle.bike_model import Vehicle
    from barc_sim.vehicle.plant import Actuator
    from barc_sim.vehicle.road import Road
    from barc_sim.vehicle.track import Track

__version__ = '0.2.0'
__all__ = [
    'LQR',
    'MPC',
    'PID',
    'Actuator',
    'LaneLQR',
    'Log',
    'PurePursuit',
    'Road',
    'Scenario',
    'SpeedMPC',
    'Stanley',
    'Track',
    'Vehicle',
    'identify',
    'lap',
    'plot',
    'racing_line',
    'read_bag',
    'simulate',
    'speed_profile',
    'summary',
    'sweep',
    'sweep_to_parquet',
]

#: The module of each name, and the name there.
_EXPORTS = {
    'LQR': ('control.speed', 'LQR'),
    'MPC': ('control.mpc', 'MPC'),
    'PID': ('control.speed', 'PID'),
    'Actuator': ('vehicle.plant', 'Actuator'),
    'LaneLQR': ('control.lane', 'LaneLQR'),
    'Log': ('simulation.log', 'Log'),
    'PurePursuit': ('control.lane', 'PurePursuit'),
    'SpeedMPC': ('control.mpc', 'SpeedMPC'),
    'Road': ('vehicle.road', 'Road'),
    'Scenario': ('simulation.scenario', 'Scenario'),
    'Stanley': ('control.lane', 'Stanley'),
    'Track': ('vehicle.track', 'Track'),
    'Vehicle': ('vehicle.bicycles', 'Vehicle'),  # of bike_model.py; bicycles.py adds its limits
    'identify': ('tuning.identification', 'identify'),
    'lap': ('simulation.closed_loop', 'lap'),
    'plot': ('figures.run_figures', 'plot'),
    'racing_line': ('control.planning', 'racing_line'),
    'read_bag': ('bags.reader', 'read'),
    'simulate': ('simulation.closed_loop', 'simulate'),
    'speed_profile': ('control.lane', 'speed_profile'),
    'summary': ('simulation.metrics', 'summary'),
    'sweep': ('tuning.sweep', 'sweep'),
    'sweep_to_parquet': ('tuning.sweep', 'sweep_to_parquet'),
}


def __getattr__(name: str) -> object:
    """Import and return the exported object `name`."""
    if name not in _EXPORTS:
        raise AttributeError(f'module {__name__!r} has no attribute {name!r}')
    module, attribute = _EXPORTS[name]
    value = getattr(import_module(f'{__name__}.{module}'), attribute)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    """Return the exported names."""
    return [*globals(), *(name for name in __all__ if name not in globals())]
