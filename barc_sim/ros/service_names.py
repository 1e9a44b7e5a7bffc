"""Names of services, relative so that a namespace moves them all.

They are those of `~/reset` and so on, but stay where they are when a node is given another name:
who calls them needs to find them.
"""

RESET = 'vehicle_simulator/reset'
PAUSE = 'vehicle_simulator/pause'
STEP = 'vehicle_simulator/step'
RESET_CONTROLLER = 'controller/reset'
RESET_RELAY = 'relay/reset'
