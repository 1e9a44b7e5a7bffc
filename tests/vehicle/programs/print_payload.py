"""Print a new parameter as a node, an environment and the plant have it, and a step."""

from __future__ import annotations

from barc_sim.learning.tasks import TASKS
from barc_sim.simulation.scenario import Scenario
from barc_sim.simulation.stepper import parameters
from barc_sim.vehicle.bike_model import Vehicle, bikeFE

table = {each.name: each for each in parameters()}
print(table['payload'].between, table['payload'].unit)

values = {name: each.default for name, each in table.items()} | {'payload': 5.0}
print(Scenario.of_parameters(values, laps=0).plant().vehicle.payload)

task = TASKS['Lane'](ranges={'payload': (1.0, 2.0)}, vehicle=Vehicle(mass=1500.0))
vehicle = task.plant({'payload': 1.5}).vehicle
print((vehicle.mass, vehicle.payload))

print(bikeFE(0.0, 0.0, 0.0, 8.0, 1.0, 0.0, 0.0, 2000.0, 0.0, 0.0, 0.02))
