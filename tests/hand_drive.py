"""A drive by hand without ROS: what the nodes of teleop do, in a plain loop."""

from __future__ import annotations

from collections import deque
from typing import TYPE_CHECKING

from barc_sim.control.driver import Driver
from barc_sim.interfaces.records import Command
from barc_sim.simulation.closed_loop import log_of_rows
from barc_sim.vehicle.plant import Plant
from barc_sim.vehicle.road import Road

if TYPE_CHECKING:
    from collections.abc import Iterable

    from barc_sim.control.driver import DriverInput
    from barc_sim.simulation.log import Log


def drive_by_hand(
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
    rows = []
    command = Command()
    period_ns, dt_ns = plant.period_ns, round(driver.dt * 1e9)
    due_ns = 0
    for k in range(round(duration / plant.ts) + 1):
        observation = plant.observe()
        while due_ns < (k + 1) * period_ns:
            t = due_ns / 1e9
            while waiting and waiting[0][0] <= t:
                received, request = waiting.popleft()
                driver.receive(request, received)
            command = driver.command(t, observation.measured.v_x)
            due_ns += dt_ns
        rows.append((observation, command, (False,)))
        plant.advance(command)
    return log_of_rows(rows, period_ns)
