"""The node `vehicle_simulator`."""
