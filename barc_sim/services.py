"""Names of services, relative so that a namespace moves them all."""

RESET = 'vehicle_simulator/reset'
PAUSE = 'vehicle_simulator/pause'

#: By which the nodes that may command are reset along with the simulator.
COMMANDERS_RESET = ('controller/reset', 'relay/reset')
