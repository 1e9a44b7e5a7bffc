"""`record`: writes the bag of any ROS 2 system."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import TYPE_CHECKING

from barc_sim.bags.recording import summary
from barc_sim.cli.parser import accept_ros_args
from barc_sim.runs.options import add_recording_options, recording

if TYPE_CHECKING:
    from argparse import Namespace

    from rclpy.node import Node

    from barc_sim.cli.parser import Parser
    from barc_sim.nodes.recorder import BagRecorder


def add_arguments(parser: Parser) -> None:
    """Describe the command."""
    parser.description = 'Record every topic that a node publishes or subscribes to, until Ctrl-C.'
    parser.epilog = 'Services bag_recorder/pause and resume, of the type std_srvs/srv/Trigger.'
    parser.add_argument(
        '-o',
        '--output',
        type=Path,
        metavar='DIR',
        help='directory of the new bag (bags/<date>_<time>)',
    )
    parser.add_argument(
        '--use-sim-time',
        action='store_true',
        help='stamp received messages with the time on /clock, as soon as there is one',
    )
    add_recording_options(parser)
    accept_ros_args(parser)


def run(options: Namespace) -> int:
    """Record until a signal or a service stops it; return the exit code."""
    from barc_sim.nodes.recorder import BagRecorder  # noqa: PLC0415 (slow: not for --help)
    from barc_sim.ros.process import spin  # noqa: PLC0415

    made: list[BagRecorder] = []

    def create() -> Node:
        made.append(
            BagRecorder(
                None,
                recording(options),
                path=options.output,
                metadata={'command': shlex.join(['barc', *options.argv])},
            )
        )
        return made[0]

    code = spin(create, options.ros_args)
    recorder, counts = made[0], made[0].counts
    lines = [f'{count:9} {topic}' for topic, count in sorted(counts.items())]
    lines.append(summary(counts, recorder.lost, recorder.left_out))
    lines.append(f'bag {recorder.path}')
    print('\n'.join(lines))  # noqa: T201
    return code
