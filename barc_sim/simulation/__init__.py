"""Vehicle and controller together: the closed loop, the log of a run, and figures of its quality.

`stepper` is the state machine of a simulator in time. Nothing here imports ROS, or starts a timer.

Four loops drive a car from state to state:

=========================  ===============================  =====================================
loop                       used by                          why
=========================  ===============================  =====================================
`closed_loop.closed_loop`  `simulate`, `lap`                any plant, and any pilot
`rollout.drive_by_pid`     `simulate` and sweeps, where     a PID straight along a road is the
                           `Plant.has_fast_path`            most common run, in half of the time
`law_runs.drive_by_laws`   sweeps of all other runs under   scores of many runs, compiled where
                           laws, on a road or a track       Numba is installed
`Stepper._step`            the node `vehicle_simulator`     one step an event: commands arrive
                                                            from outside, and deadlines can pass
=========================  ===============================  =====================================

They call the same laws in the same order, so that their states are equal to the last bit;
`tests/simulation/` compares them. All except `drive_by_pid` take a step with `advance` of
`vehicle/plant.py`, and so does `learning/batch.py`, which steps the cars of many environments.
`drive_by_pid` calls the parts of `advance` that a straight drive needs.
"""
