"""`record`: writes the bag of any ROS 2 system."""

from __future__ import annotations

import shlex
from argparse import ArgumentTypeError
from pathlib import Path
from typing import TYPE_CHECKING

from barc_sim.bags.recording import COMPRESSIONS, summary
from barc_sim.cli.files import read_regular
from barc_sim.cli.parser import accept_ros_args, number
from barc_sim.runs.options import add_recording_options, recording

if TYPE_CHECKING:
    from argparse import Namespace

    from rclpy.node import Node

    from barc_sim.cli.parser import Parser
    from barc_sim.nodes.recorder import BagRecorder

_EPILOG = (
    'Services bag_recorder/pause, resume, is_paused, split_bagfile and snapshot, of the type '
    'std_srvs/srv/Trigger.'
)
_SNAPSHOT, _MAX_SNAPSHOT = 10.0, 3600.0  #: [s]


def add_arguments(parser: Parser) -> None:
    """Describe the command."""
    parser.description = 'Record every topic that a node publishes or subscribes to, until Ctrl-C.'
    parser.epilog = _EPILOG
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
    _add_more(parser)
    add_recording_options(parser)
    accept_ros_args(parser)


def _add_more(parser: Parser) -> None:
    """Add the options that a run does not have."""
    parser.add_argument('--start-paused', action='store_true', help='begin paused; see resume')
    parser.add_argument(
        '--snapshot',
        '--snapshot-mode',
        type=number(0.1, _MAX_SNAPSHOT),
        nargs='?',
        const=_SNAPSHOT,
        metavar='S',
        help='keep the last seconds in memory, and write them only when bag_recorder/snapshot is '
        f'called ({_SNAPSHOT:g})',
    )
    parser.add_argument(
        '--compression', choices=COMPRESSIONS, default='zstd', help='of each chunk (zstd)'
    )
    parser.add_argument(
        '--qos-profile-overrides-path',
        dest='qos',
        type=_qos,
        default={},
        metavar='FILE',
        help='YAML with the quality of service to request, by topic, as for ros2 bag record',
    )


def _qos(text: str) -> dict[str, dict[str, object]]:
    from barc_sim.bags.bounds import MAX_TEXT, from_yaml  # noqa: PLC0415 (slow: not for --help)

    try:
        found = from_yaml(read_regular(Path(text), MAX_TEXT).decode())
        return {str(topic): dict(qos) for topic, qos in found.items()}
    except (AttributeError, OSError, TypeError, ValueError) as error:
        raise ArgumentTypeError(
            f'{text!r} has no quality of service by topic ({error}): write it as in '
            '/scan: {depth: 10}'
        ) from None


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
