"""The closed loop of vehicle and controller without ROS: the nodes' trajectory bit for bit.

`simulate` takes what a user has in mind, `closed_loop` a plant and a controller, and `drive` the
requests of a driver. A plain PID in a plain car takes the fast way of `straight_loop`.
"""

from __future__ import annotations

import inspect
from array import array
from collections import deque
from itertools import repeat
from math import isfinite, nan, radians
from typing import TYPE_CHECKING, Any

import numpy as np

from barc_sim.control.adapter import as_controller
from barc_sim.control.driver import Driver
from barc_sim.control.pid import (
    ACCELERATION_LIMIT,
    FIRST_DT,
    PID,
    SPEED_REFERENCE,
    speed_controller,
)
from barc_sim.errors import UserError
from barc_sim.simulation import straight_loop
from barc_sim.simulation.log import Log, recordable
from barc_sim.vehicle.actuators import Actuator
from barc_sim.vehicle.bike_model import Input, bikeFE, forces
from barc_sim.vehicle.plant import Plant
from barc_sim.vehicle.road import Road
from barc_sim.vehicle.sensor import Deviation

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence
    from os import PathLike

    from numpy.typing import NDArray

    from barc_sim.control.controller import Controller
    from barc_sim.control.driver import DriverInput
    from barc_sim.vehicle.bike_model import Model, Vehicle
    from barc_sim.vehicle.lateral_dynamics import LateralParameters
    from barc_sim.vehicle.plant import Observation

DISTANCE = 180.0  #: [m] of a run
MAX_DURATION = 600.0  #: [s]


def simulate(
    kp: float | None = None,
    ki: float | None = None,
    kd: float | None = None,
    *,
    road: Road | str | PathLike[str] = 'lab',
    vehicle: Vehicle | None = None,
    noise: float | Deviation = 0.0,
    delay: float = 0.0,
    controller: object | None = None,
    model: Model = bikeFE,
    speed_reference: float = SPEED_REFERENCE,
    distance: float = DISTANCE,
    max_duration: float = MAX_DURATION,
    seed: int = 0,
    acceleration_limit: float = ACCELERATION_LIMIT,
    integrator: str = 'euler',
    dynamics: str = 'kinematic',
    lateral: LateralParameters | None = None,
    ts: float = 0.02,
) -> Log:
    """Return the log of a cruise-control run: the trajectory of `acc` with these options.

    Parameters
    ----------
    kp, ki, kd
        Gains of the PID; those of `acc` where they are not given.
    road
        A road, 'lab', 'flat', or the path of a CSV file with the columns `start_m,grade_deg`.
    vehicle
        Its parameters; the lab's where they are not given.
    noise
        Standard deviation of the measured speed [m/s], or of every signal.
    delay
        [s] from a command to its effect.
    controller
        An object with the lab's `acc_calculate(speed_reference, speed_current)`, to which dt [s]
        is a third argument if it takes one. A copy of it drives in the place of the PID.
    model
        A function with the arguments and the result of `bikeFE`; `l_f`, `l_r` and `g` are passed
        if it has parameters of these names.
    speed_reference, distance, max_duration
        [m/s], [m], [s]: the run ends at `distance`, or after `max_duration` of simulated time.
    seed
        Of the noise.
    acceleration_limit
        [m/s²] limit of the command either way.
    integrator, dynamics, lateral, ts
        As in `Plant`.

    Raises
    ------
    UserError
        where the road cannot be read, or the arguments contradict one another.
    """
    given = {'kp': kp, 'ki': ki, 'kd': kd}
    gains = {name: gain for name, gain in given.items() if gain is not None}
    if controller is not None and gains:
        raise UserError(
            f'{", ".join(gains)} are gains of the PID, and controller={controller!r} is in its '
            'place: give one or the other'
        )
    plant = Plant(
        road=road if isinstance(road, Road) else Road.named(str(road)),
        vehicle=vehicle,
        ts=ts,
        noise=noise if isinstance(noise, Deviation) else Deviation(v_x=noise),
        seed=seed,
        model=model if model is bikeFE else _with_options(model),
        motor=Actuator(delay=delay),
        integrator=integrator,
        dynamics=dynamics,
        lateral=lateral,
    )
    driving: Controller = PID(**gains) if controller is None else as_controller(controller)
    driving.output_min, driving.output_max = -acceleration_limit, acceleration_limit
    driving.reset()
    return closed_loop(
        plant,
        driving,
        speed_reference=speed_reference,
        distance=distance,
        max_duration=max_duration,
    )


def closed_loop(
    plant: Plant | None = None,
    controller: Controller | None = None,
    *,
    speed_reference: float = SPEED_REFERENCE,
    distance: float = DISTANCE,
    max_duration: float = MAX_DURATION,
) -> Log:
    """Drive until `distance` [m] is reached, or for `max_duration` [s] of simulated time.

    `plant` and `controller`, those of a run unless given, are left as the run left them. The last
    row is the first state at or beyond `distance`, with the command that answers it.
    """
    plant = plant or Plant()
    controller = speed_controller() if controller is None else as_controller(controller)
    steps = round(max_duration / plant.ts)
    if type(controller) is PID and plant.is_straight:
        log = _straight(plant, controller, speed_reference, distance, steps)
        if log is not None:
            return log
    terms = recordable(controller.terms)
    rows = _Rows(plant.ts)
    dt = FIRST_DT
    for _ in range(steps + 1):
        seen = plant.observe()
        motor = controller.acc_calculate(speed_reference, seen.measured.v_x, dt)
        command = Input(motor, 0.0)
        rows.add(
            (
                seen,
                command,
                controller.saturated,
                [getattr(controller, name) for name in terms],
            )
        )
        if plant.state.x >= distance:
            break
        plant.advance(command)
        dt = _period_ns(plant.ts) / 1e9  # as the nodes take it from stamps
    return rows.log(speed_reference, terms)


def _straight(
    plant: Plant, pid: PID, speed_reference: float, distance: float, steps: int
) -> Log | None:
    """Return the log by the fast loop; None, with nothing done, where a number is not finite."""
    state, vehicle, road = plant.state, plant.vehicle, plant.road
    dt = _period_ns(plant.ts) / 1e9
    setting = straight_loop.Setting(
        reference=speed_reference,
        low=pid.output_min,
        high=pid.output_max,
        drag=vehicle.air_drag_coeff,
        friction=vehicle.friction,
        mass=vehicle.mass,
        ts=plant.ts,
        dt=dt,
        distance=distance,
    )
    start = straight_loop.Start(state.x, state.v, pid.integral)
    if pid.previous is not None:
        start = start._replace(previous=pid.previous, dt=FIRST_DT)
    lists: tuple[list[float], ...] = tuple([] for _ in range(7))
    straight_loop.trace(
        pid.kp,
        pid.ki,
        pid.kd,
        setting,
        straight_loop.Stretches.of(road, vehicle),
        repeat(-0.0, steps + 1),  # which also leaves a speed of -0.0 as it is
        [],
        start,
        tuple(each.append for each in lists),
    )
    columns = tuple(array('d', each) for each in lists[:-1])
    x, v, motor, proportional, integral, derivative = map(np.frombuffer, columns)
    if not all(isfinite(column[-1]) for column in columns):
        return None
    n, zero = len(x), np.zeros(len(x))
    _catch_up(plant, pid, setting, columns)
    stretch, elevation = road.profile(x)
    acting: Any = forces(v, 0.0, vehicle)  # type: ignore[arg-type]  # arrays
    theta_deg = np.array(road.grades_deg)[stretch]
    gravity = [forces(0.0, radians(grade), vehicle).gravity for grade in road.grades_deg]
    return Log(
        t=_times(n, plant.ts),
        x=x,
        y=np.full(n, state.y),
        psi=zero,
        v_x=v,
        v_y=v * 0.0,
        psi_dot=v * 0.0,
        e_s=zero,
        e_ey=zero,
        e_epsi=zero,
        e_v_x=zero,
        e_v_y=zero,
        e_psi_dot=zero,
        motor=motor,
        servo=zero,
        missed=np.zeros(n, np.bool_),
        theta_deg=theta_deg,
        elevation=elevation,
        friction=acting.friction,
        drag=acting.drag,
        gravity=np.array(gravity)[stretch],
        reference=np.full(n, speed_reference),
        proportional=proportional,
        integral=integral,
        derivative=derivative,
        saturated=np.frombuffer(bytes(map(bool, lists[-1])), np.bool_),
    )


def _catch_up(
    plant: Plant, pid: PID, setting: straight_loop.Setting, columns: tuple[array[float], ...]
) -> None:
    """Leave plant and controller as the general loop does: repeat the last step by them."""
    x, v, motor, _, integral, _ = columns
    arrived = x[-1] >= setting.distance
    last = len(x) - 1
    if last > 0:
        pid.previous, pid.integral = v[last - 1], integral[last - 1]
    pid.acc_calculate(setting.reference, v[last], setting.dt if last else FIRST_DT)
    step = last - 1 if arrived else last
    if step >= 0:
        plant.place(plant.state._replace(x=x[step], v=v[step]))
        plant.advance(Input(motor[step], 0.0))


def drive(
    requests: Iterable[tuple[float, DriverInput]],
    duration: float,
    *,
    plant: Plant | None = None,
    driver: Driver | None = None,
) -> Log:
    """Drive by hand for `duration` [s]: `requests`, each at its time [s], are the driver's inputs.

    A recorded `cmd_vel` gives the same trajectory each time, bit for bit: a command is made at
    every multiple of the driver's `dt`, of the requests up to then, and acts from the state on
    in whose period it is made. `plant`, on the flat, and `driver`, those of a run unless given,
    are left as the run left them.
    """
    plant = plant or Plant(road=Road.flat())
    driver = driver or Driver()
    waiting = deque(sorted(requests, key=lambda request: request[0]))
    rows = _Rows(plant.ts)
    command = Input()
    period_ns, dt_ns = _period_ns(plant.ts), _period_ns(driver.dt)
    due_ns = 0
    for k in range(round(duration / plant.ts) + 1):
        seen = plant.observe()
        while due_ns < (k + 1) * period_ns:
            t = due_ns / 1e9
            while waiting and waiting[0][0] <= t:
                received, request = waiting.popleft()
                driver.receive(request, received)
            command = driver.command(t, seen.measured.v_x)
            due_ns += dt_ns
        rows.add((seen, command, False, ()))
        plant.advance(command)
    return rows.log()


class _Rows:
    """The rows of a log in the making: observation, command, saturation and terms."""

    def __init__(self, ts: float) -> None:
        """Begin without rows, for steps of `ts` seconds."""
        self._ts = ts
        self._rows: list[tuple[Observation, Input, bool, Sequence[float]]] = []
        self.add = self._rows.append

    def log(self, speed_reference: float = nan, terms: Sequence[str] = ()) -> Log:
        """Return the log; its columns have the names of the records' fields, and of `terms`."""
        seen, commands, saturated, values = zip(*self._rows, strict=True)
        n = len(seen)
        found = dict(zip(terms, np.array(values, dtype=np.float64).T.copy(), strict=True))
        return Log(
            t=_times(n, self._ts),
            **_columns([each.measured for each in seen]),
            **_columns([each.error for each in seen], 'e_'),
            **_columns(commands),
            missed=np.zeros(n, np.bool_),
            theta_deg=np.array([each.theta_deg for each in seen]),
            elevation=np.array([each.elevation for each in seen]),
            **_columns([each.forces for each in seen]),
            reference=np.full(n, speed_reference),
            saturated=np.array(saturated, np.bool_),
            **{name: found.pop(name, np.full(n, nan)) for name in PID.terms},
            own_terms=found,
        )


def _columns(records: Sequence[Any], prefix: str = '') -> dict[str, NDArray[np.float64]]:
    """Return an array, shape `(n,)`, for each field of `n` records."""
    names = [prefix + name for name in records[0]._fields]
    return dict(zip(names, np.array(records, dtype=np.float64).T.copy(), strict=True))


def _period_ns(ts: float) -> int:
    """Return a step of `ts` seconds in whole nanoseconds, as the stamps of states have it."""
    return round(ts * 1e9)


def _times(n: int, ts: float) -> NDArray[np.float64]:
    return np.arange(n) * _period_ns(ts) / 1e9


def _with_options(model: Model) -> Model:
    """Return `model` with those of the arguments `l_f`, `l_r` and `g` that it takes."""
    parameters = inspect.signature(model).parameters.values()
    if any(each.kind is inspect.Parameter.VAR_KEYWORD for each in parameters):
        return model
    names = {each.name for each in parameters}

    def adapted(*state_and_input: float, **options: float) -> Sequence[float]:
        taken = {name: value for name, value in options.items() if name in names}
        return model(*state_and_input, **taken)

    return adapted
