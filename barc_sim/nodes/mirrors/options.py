"""Which mirrors there are, and the options of a run that choose among them."""

from __future__ import annotations

import argparse

from barc_sim.cli.option_types import FOXGLOVE_PORT, GREATEST_PORT, whole

#: By the name of the parameter of `mirror` that turns each on and off: what it publishes.
MIRRORS = {
    'odom': 'the pose and the velocity, as nav_msgs/Odometry',
    'tf': 'the same pose as a transform, where ROS has the package tf2_msgs',
    'path': 'the way so far, as nav_msgs/Path, once a second',
    'markers': 'the car and the road for RViz and Foxglove',
    'accel': 'the acceleration over the ground, as geometry_msgs/AccelStamped',
    'joint_states': 'how the wheels stand and roll, as sensor_msgs/JointState',
    'diagnostics': 'the timing, the command, the noise and the bag, once a second',
}


def add_mirror_options(parser: argparse.ArgumentParser) -> None:
    """Add `--mirrors` and `--foxglove`."""
    parser.add_argument(
        '--mirrors',
        type=_mirrors,
        metavar='NAMES',
        help='standard messages for RViz, Foxglove and PlotJuggler: all, none, or some of '
        f'{",".join(MIRRORS)} (none)',
    )
    parser.add_argument(
        '--foxglove',
        type=whole(0, GREATEST_PORT),
        nargs='?',
        const=FOXGLOVE_PORT,
        metavar='PORT',
        help='serve every topic live to the Foxglove app, with all mirrors unless --mirrors says '
        f'otherwise, on this machine only ({FOXGLOVE_PORT})',
    )


def wanted(options: argparse.Namespace) -> frozenset[str]:
    """Return the mirrors that are wanted: all for Foxglove, unless it is said which."""
    chosen = getattr(options, 'mirrors', None)
    if chosen is None:
        return frozenset(() if getattr(options, 'foxglove', None) is None else MIRRORS)
    return frozenset(chosen)


def _mirrors(text: str) -> frozenset[str]:
    if text in ('all', 'none'):
        return frozenset(MIRRORS if text == 'all' else ())
    names = frozenset(text.split(','))
    if not names <= set(MIRRORS):
        raise argparse.ArgumentTypeError(
            f"{text!r} is neither 'all', 'none' nor some of {','.join(MIRRORS)}"
        )
    return names
