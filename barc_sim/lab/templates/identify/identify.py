"""Identification: choose 60 s of commands, and estimate drag, friction and delay of your car."""

# You can use NumPy: import numpy as np

NAME = 'your name'  # each name has a car of its own


def command(t):
    """Return the acceleration command [m/s²] at the time t [s], from 0 to 60 s.

    The car starts at rest on a flat road. Keep the commands from -2 to 2 m/s², and the speed from 0
    to 15 m/s.
    """
    # TODO

    # Then replace the next line by: return a
    raise NotImplementedError


def estimate(t, v, a):
    """Return [drag, drag_interval, friction, friction_interval, delay, delay_interval].

    t  [s]     3000 times, as a list; v and a are lists of the same length
    v  [m/s]   the measured speed at each time, with noise of 0.03 m/s
    a  [m/s²]  the command at each time

    drag      [1/m]   a_0 / m of    dv/dt = a(t - delay) - drag * v**2 - friction
    friction  [m/s²]  F_f / m
    delay     [s]     from a command to its effect

    In 95 of 100 drives, value ± interval must contain the true value.
    """
    # TODO

    # Then replace the next line by: return [drag, ..., delay_interval]
    raise NotImplementedError


if __name__ == '__main__':  # after a drive: python identify.py bags/*; your last one is used
    import sys

    from barc_sim.lab.own_estimate import print_estimate

    print_estimate(estimate, sys.argv[1:])
