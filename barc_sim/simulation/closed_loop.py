"""The runs without ROS: cruise control, the nodes' trajectory bit for bit, and driving by hand."""

from __future__ import annotations

from collections import deque
from math import nan
from typing import TYPE_CHECKING

import numpy as np

from barc_sim.control.adapter import as_controller
from barc_sim.control.driver import Driver
from barc_sim.control.pid import FIRST_DT, PID, SPEED_REFERENCE, speed_controller
from barc_sim.simulation.log import COLUMNS, Log, recordable
from barc_sim.vehicle.bike_model import Input
from barc_sim.vehicle.plant import Plant
from barc_sim.vehicle.road import Road

if TYPE_CHECKING:
    from collections.abc import Iterable

    from barc_sim.control.controller import Controller
    from barc_sim.control.driver import DriverInput


def closed_loop(
    plant: Plant | None = None,
    controller: Controller | None = None,
    *,
    speed_reference: float = SPEED_REFERENCE,
    distance: float = 180.0,
    max_duration: float = 600.0,
) -> Log:
    """Drive until `distance` [m] is reached, or for `max_duration` [s] of simulated time.

    `plant` and `controller`, those of a run unless given, are left as the run left them. The
    last row is the first state at or beyond `distance`, with the command that answers it.
    """
    plant = plant or Plant()
    controller = speed_controller() if controller is None else as_controller(controller)
    terms = recordable(controller.terms)
    rows: list[tuple[float, ...]] = []
    dt = FIRST_DT
    period_ns = round(plant.ts * 1e9)
    steps = round(max_duration / plant.ts)
    for k in range(steps + 1):
        seen = plant.observe()
        command = Input(controller.acc_calculate(speed_reference, seen.measured.v_x, dt), 0.0)
        rows.append(
            (
                k * period_ns / 1e9,
                *seen.measured,
                *seen.error,
                *command,
                seen.theta_deg,
                seen.elevation,
                *seen.forces,
                speed_reference,
                controller.saturated,
                *[getattr(controller, name) for name in terms],
            )
        )
        if plant.state.x >= distance:
            break
        plant.advance(command)
        # As the nodes take it from stamps, which are whole nanoseconds.
        dt = period_ns / 1e9
    return _log(rows, terms)


def drive(
    requests: Iterable[tuple[float, DriverInput]],
    duration: float,
    *,
    plant: Plant | None = None,
    driver: Driver | None = None,
) -> Log:
    """Drive as `requests` say, each heard at its time [s], for `duration` [s]: the relay's loop.

    A recorded `cmd_vel` gives the same trajectory each time, bit for bit: a command is made at
    every multiple of the driver's `dt`, of the requests heard by then, and acts from the state on
    whose period it falls in. `plant`, on the flat, and `driver` are the run's defaults unless
    given, and are left as the run left them.
    """
    plant = plant or Plant(road=Road.flat())
    driver = driver or Driver()
    waiting = deque(sorted(requests, key=lambda request: request[0]))
    rows: list[tuple[float, ...]] = []
    command = Input()
    period_ns, dt_ns = round(plant.ts * 1e9), round(driver.dt * 1e9)
    due_ns = 0
    for k in range(round(duration / plant.ts) + 1):
        seen = plant.observe()
        while due_ns < (k + 1) * period_ns:
            t = due_ns / 1e9
            while waiting and waiting[0][0] <= t:
                heard, request = waiting.popleft()
                driver.receive(request, heard)
            command = driver.command(t, seen.measured.v_x)
            due_ns += dt_ns
        rows.append(
            (
                k * period_ns / 1e9,
                *seen.measured,
                *seen.error,
                *command,
                seen.theta_deg,
                seen.elevation,
                *seen.forces,
                nan,
                False,
            )
        )
        plant.advance(command)
    return _log(rows)


def _log(rows: list[tuple[float, ...]], terms: tuple[str, ...] = ()) -> Log:
    """Return the log of rows in the order of `Log`'s columns, `terms` last, `missed` left out."""
    columns = np.array(rows, dtype=np.float64).T.copy()
    fixed = [name for name in COLUMNS if name != 'missed' and name not in PID.terms]
    arrays = dict(zip((*fixed, *terms), columns, strict=True))
    saturated = arrays.pop('saturated').astype(np.bool_)
    own = {name: arrays.pop(name) for name in terms if name not in COLUMNS}
    unknown = {name: np.full(len(rows), nan) for name in PID.terms if name not in arrays}
    missed = np.zeros(len(rows), dtype=np.bool_)
    return Log(**arrays, **unknown, saturated=saturated, missed=missed, own_terms=own)
