"""Command: record any ROS 2 system into a bag, until Ctrl-C."""

from __future__ import annotations

import shlex
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from barc_sim.cli.parser import Parser, call
from barc_sim.runs.recording_options import add_recording_options, recording

if TYPE_CHECKING:
    from argparse import Namespace
    from collections.abc import Sequence

    from rclpy.node import Node

    from barc_sim.nodes.recorder.node import BagRecorder

PROG = 'barc record'
_EPILOG = (
    'Services bag_recorder/pause, resume, is_paused, split_bagfile, stop and record, all of '
    'std_srvs/srv/Trigger. What follows --ros-args goes to ROS.'
)


def parser() -> Parser:
    """Return the command's options."""
    parser = Parser(
        prog=PROG,
        description='Record every topic, as soon as it has a publisher, until Ctrl-C.',
        epilog=_EPILOG,
    )
    parser.add_argument(
        '-o',
        '--output',
        type=Path,
        metavar='DIR',
        help='directory of the bag, to be made (bags/<date>_<time>)',
    )
    parser.add_argument(
        '--use-sim-time',
        action='store_true',
        help='messages are received at the time that /clock tells, once it is heard',
    )
    add_recording_options(parser)
    return parser


def record(options: Namespace, argv: Sequence[str], ros_args: list[str]) -> int:
    """Record until a signal or a service asks to stop; return the exit code.

    Raises
    ------
    UserError
        The bag cannot be made.
    """
    from barc_sim.nodes.recorder.node import BagRecorder  # noqa: PLC0415 (--help is to be quick)
    from barc_sim.ros.process import spin  # noqa: PLC0415

    made: list[BagRecorder] = []

    def create() -> Node:
        made.append(
            BagRecorder(
                None,
                recording(options),
                path=options.output,
                metadata={'command': shlex.join([PROG, *argv])},
            )
        )
        return made[0]

    code = spin(create, ros_args)
    print(report(made[0]))  # noqa: T201
    return code


def report(recorder: BagRecorder) -> str:
    """Return what was recorded, topic by topic, and lost; and where it is."""
    from barc_sim.bags.losses import summary  # noqa: PLC0415

    counts = recorder.counts
    lines = [f'{count:9} {topic}' for topic, count in sorted(counts.items())]
    return '\n'.join([*lines, summary(counts, recorder.lost), f'bag {recorder.path}'])


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command and return its exit code."""
    argv = list(sys.argv[1:] if argv is None else argv)
    cut = argv.index('--ros-args') if '--ros-args' in argv else len(argv)
    options = parser().parse_args(argv[:cut])
    return call(PROG, lambda: record(options, argv, argv[cut:]))


if __name__ == '__main__':
    sys.exit(main())
