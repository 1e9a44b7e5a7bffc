"""`record`, `play`, `info`, `convert` and `recover`: bags of any ROS 2 system."""

from __future__ import annotations

import shlex
import sys
from argparse import ArgumentTypeError
from contextlib import ExitStack, suppress
from datetime import datetime, timezone
from pathlib import Path
from typing import TYPE_CHECKING, Any

from barc_sim.bags.messages import CDR
from barc_sim.bags.playback_settings import RATE, Playback
from barc_sim.cli.parser import ROS_ARGS, accept_ros_args, add_bag, number, show, whole
from barc_sim.cli.process import require_ros
from barc_sim.errors import UserError
from barc_sim.parallel.options import add_executor_options, interruptible_executor_of
from barc_sim.runs.recording_options import (
    add_control_options,
    add_qos_overrides,
    add_recording_options,
    add_selection_options,
    add_topic_choice,
    key_and_value,
    recording,
)

if TYPE_CHECKING:
    from argparse import Namespace
    from collections.abc import Iterator

    from barc_sim.bags.conversions import Conversion
    from barc_sim.bags.recovery import Recovery
    from barc_sim.cli.parser import Parser

_CLOCK_RATES = (1e-3, 1e3)  #: [Hz]
_MAX_SECONDS = 1e9
_MAX_TIME = 9e9  #: [s] since the epoch
_MIN_DURATION = 1e-3  #: [s]
_CLOCK_RATE = 40.0  #: [Hz] as in ros2 bag play


def add_arguments_record(parser: Parser) -> None:
    """Describe the command."""
    parser.description = 'Record every topic that a node publishes or subscribes to, until Ctrl-C.'
    parser.epilog = (
        'Keys: space pauses and resumes, q ends. Services: bag_recorder/pause, resume, '
        'split_bagfile and snapshot (std_srvs/srv/Trigger).'
    )
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
        help='stamp messages with the time on /clock; record none before its first message',
    )
    parser.add_argument(
        '--custom-data',
        type=key_and_value,
        nargs='+',
        action='extend',
        default=[],
        metavar='KEY=VALUE',
        help="add this to the bag's metadata, as custom_data of metadata.yaml",
    )
    parser.add_argument(
        '-a', '--all', action='store_true', help='record every topic, which is the default'
    )
    add_selection_options(parser)
    add_control_options(parser)
    add_qos_overrides(parser, 'record')
    add_recording_options(parser)
    accept_ros_args(parser)


def run_record(options: Namespace) -> int:
    """Record until a signal or a service stops it; return the exit code."""
    require_ros('barc record')
    from barc_sim.control.keyboard import Terminal  # noqa: PLC0415 (slow: not for --help)
    from barc_sim.nodes.recorder import BagRecorder  # noqa: PLC0415
    from barc_sim.nodes.recorder_rosbag2 import Rosbag2RecorderServices  # noqa: PLC0415
    from barc_sim.ros.process import spin  # noqa: PLC0415

    if options.all and (options.topics or options.topic_types):
        raise UserError('--all records every topic: leave it out, or --topics and --topic-types')
    settings = recording(options)
    metadata = {**dict(options.custom_data), 'command': shlex.join(['barc', *options.argv])}

    with ExitStack() as end:

        def create() -> BagRecorder:
            recorder = BagRecorder(recording=settings, path=options.output, metadata=metadata)
            with suppress(ModuleNotFoundError):  # the types of these services
                Rosbag2RecorderServices(recorder)
            with suppress(UserError):  # without a terminal there are no keys
                end.enter_context(Terminal()).listen(recorder.on_key)
            return recorder

        recorder = spin(create, options.ros_args)

    lines = [f'{count:9} {topic}' for topic, count in sorted(recorder.counts.items())]
    lines.append(recorder.summary)
    lines.append(f'bag {recorder.path}')
    show('\n'.join(lines))
    return 1 if recorder.failure else 0


def add_arguments_play(parser: Parser) -> None:
    """Describe the command."""
    parser.description = (
        'Publish the messages of bags of any recorder on their topics, with their quality '
        'of service and time spacing, as `ros2 bag play` does. Several bags are played as one.'
    )
    parser.epilog = (
        'Keys: space pauses and resumes, the right arrow steps one message, up and down change the '
        'rate, q ends. Services: bag_player/pause, resume, toggle_paused, play_next and stop '
        '(std_srvs/srv/Trigger). Parameters of bag_player: rate, and seek_to.'
    )
    parser.add_argument(
        'bags',
        nargs='*',
        type=Path,
        metavar='BAG',
        help='directories or files of bags (the newest in ./bags)',
    )
    parser.add_argument(
        '-r',
        '--rate',
        type=number(*RATE.between),
        default=RATE.default,
        metavar='RATE',
        help=f'{RATE.description} ({RATE.default:g})',
    )
    parser.add_argument(
        '-l', '--loop', action='store_true', help='begin again at the end, until Ctrl-C'
    )
    parser.add_argument(
        '--start-offset',
        type=number(0.0, _MAX_SECONDS),
        default=0.0,
        metavar='S',
        help='begin at this time after the start of the bag [s]',
    )
    parser.add_argument(
        '--playback-duration',
        dest='duration',
        type=number(_MIN_DURATION, _MAX_SECONDS),
        metavar='S',
        help='end after this time in the bag [s] (play to its end)',
    )
    until = parser.add_mutually_exclusive_group()
    until.add_argument(
        '--playback-until-sec',
        dest='until',
        type=_seconds_since_epoch,
        metavar='T',
        help='end at this time of the bag, since 1970 [s]; with --playback-duration, the later '
        'end counts',
    )
    until.add_argument(
        '--playback-until-nsec',
        dest='until',
        type=whole(0, _MAX_TIME * 1e9),
        metavar='T',
        help='the same in nanoseconds',
    )
    parser.add_argument(
        '-d',
        '--delay',
        type=number(0.0, _MAX_SECONDS),
        default=0.0,
        metavar='S',
        help='wait before the bag begins, each time [s] (0)',
    )
    parser.add_argument('-p', '--start-paused', action='store_true', help='begin paused')
    add_topic_choice(parser, 'play')
    parser.add_argument(
        '-m',
        '--remap',
        type=_remapping,
        nargs='+',
        default=[],
        metavar='OLD:=NEW',
        help='publish a topic under another name, as in /ecu:=/car2/ecu',
    )
    add_qos_overrides(parser, 'play')
    parser.add_argument(
        '--clock',
        type=number(*_CLOCK_RATES),
        nargs='?',
        const=_CLOCK_RATE,
        metavar='HZ',
        help=f"publish the bag's time on /clock, in place of its recorded /clock ({_CLOCK_RATE:g})",
    )
    accept_ros_args(parser)


def _remapping(text: str) -> str:
    """Return a rule OLD:=NEW."""
    old, _, new = text.partition(':=')
    if not old or not new:
        raise ArgumentTypeError(f'{text!r} is not OLD:=NEW, as in /ecu:=/car2/ecu')
    return text


def _seconds_since_epoch(text: str) -> int:
    """Return a time [s] of the command line in nanoseconds."""
    return round(number(0.0, _MAX_TIME)(text) * 1e9)


def run_play(options: Namespace) -> int:
    """Play the bag to its end or until a signal; return the exit code."""
    require_ros('barc play')
    from barc_sim.bags.reader import newest  # noqa: PLC0415 (slow: not for --help)
    from barc_sim.control.keyboard import Terminal  # noqa: PLC0415
    from barc_sim.nodes.player import BagPlayer  # noqa: PLC0415
    from barc_sim.ros.process import PLAYER_PROFILES, spin, use_profiles  # noqa: PLC0415

    use_profiles(profiles=PLAYER_PROFILES)
    bags = options.bags or [newest()]
    playback = Playback(**{name: getattr(options, name) for name in Playback._fields})
    ros_args = [*options.ros_args]
    if options.remap:
        ros_args.append(ROS_ARGS)
    for rule in options.remap:
        ros_args += ['--remap', rule]

    with ExitStack() as end:

        def create() -> BagPlayer:
            player = BagPlayer(bags, playback, _show)
            with suppress(UserError):  # without a terminal there are no keys
                end.enter_context(Terminal()).listen(player.controls.on_key)
            return player

        player = spin(create, ros_args)

    _show('')
    print(f'played {player.progress.strip()}')  # noqa: T201
    return 1 if player.failure else 0


def _show(line: str) -> None:
    if sys.stderr.isatty():
        print(f'\r\x1b[K{line}', end='', file=sys.stderr, flush=True)  # noqa: T201


def _bag(options: Namespace) -> Path:
    from barc_sim.bags.reader import newest  # noqa: PLC0415 (slow: not for --help)

    return options.bag or newest()


def add_arguments_info(parser: Parser) -> None:
    """Describe the command."""
    parser.description = 'Print what is in a bag of any recorder, as `ros2 bag info` does.'
    parser.epilog = 'It reads every message, so that it counts only readable ones.'
    add_bag(parser)
    parser.add_argument('--json', action='store_true', help='print JSON')


def run_info(options: Namespace) -> None:
    """Read the bag, and print what is in it."""
    import json  # noqa: PLC0415 (not for --help)

    from barc_sim.bags.contents import describe  # noqa: PLC0415 (slow: not for --help)

    contents = describe(_bag(options))
    if options.json:
        show(json.dumps(contents, indent=2))
        return
    for line in _described(contents):
        show(line)


def _described(contents: dict[str, Any]) -> Iterator[str]:
    """Yield the lines of a description, similar to those of `ros2 bag info`."""
    yield from _file_lines(contents['file_spans'])
    yield f'Bag size:  {sum(contents["files"].values()) / 1024:.1f} KiB'
    yield f'Duration:  {contents["duration"]:.9f} s'
    yield f'Start:     {_date(contents["start_nanoseconds"])}'
    yield f'Messages:  {contents["messages"]}'
    for topic in contents['topics']:
        yield _topic_line(topic['name'], topic['type'], topic['encoding'], topic['messages'])
    yield from _damages(contents['damages'])
    for name, text in (*contents['losses'].items(), *contents['metadata'].items()):
        if name not in ('parameters', 'graph'):  # long
            yield f'{name}: {" ".join(text.split())}'


def _file_lines(spans: dict[str, dict[str, Any]]) -> Iterator[str]:
    """Yield the names of the files; of several, each with its start, duration and messages."""
    title = 'Files:    '
    for name, span in spans.items():
        if len(spans) == 1:
            yield f'{title} {name}'
        elif not span['messages']:
            yield f'{title} {name}: no messages'
        else:
            times = f'{_date(span["start_nanoseconds"])}, {span["duration"]:.9f} s'
            yield f'{title} {name}: {times}, {span["messages"]} messages'
        title = ' ' * len(title)


def _date(nanoseconds: int) -> str:
    """Return a time since 1970 as a local date."""
    seconds, fraction = divmod(nanoseconds, 1_000_000_000)
    date = datetime.fromtimestamp(seconds, timezone.utc).astimezone()
    return f'{date:%b %d %Y %H:%M:%S}.{fraction // 1000:06} ({seconds}.{fraction:09})'


def _topic_line(name: str, type_name: str, encoding: str, count: int) -> str:
    other = '' if encoding == CDR else f' in {encoding or "an unknown encoding"}'
    return f'{count:9} {name} [{type_name or "no schema"}]{other}'


def _damages(damages: dict[str, dict[str, int]]) -> Iterator[str]:
    for name, damage in damages.items():
        if chunks := damage['unreadable_chunks']:
            yield f'{name}: chunks left out, as they are damaged or too large: {chunks}'
        if damage['unfinished']:
            unread = 'all whole records are read'
            if damage['unread']:
                unread = f'{damage["unread"]} bytes at its end are unread'
            yield f'{name} is unfinished or damaged: {unread}'


def add_arguments_convert(parser: Parser) -> None:
    """Describe the command."""
    parser.description = (
        'Convert bags of any recorder to tables, a CSV file for each topic; of a run, also '
        'run.csv, with a row for each state, its lap and its parameters.'
    )
    parser.epilog = 'Convert bags of ROS 1 with `rosbags-convert` first.'
    parser.add_argument(
        'bags',
        nargs='*',
        type=Path,
        metavar='BAG',
        help='its directory, or a file of it (the newest in ./bags)',
    )
    parser.add_argument(
        '-o',
        '--output',
        type=Path,
        metavar='DIR',
        help='new folder (./BAG_csv); of several bags, the folder in which each gets its BAG_csv',
    )
    add_topic_choice(parser, 'convert')
    add_executor_options(parser, 'bags', '1')


def run_convert(options: Namespace) -> int:
    """Convert the bags, and print where each is; return the exit code."""
    from barc_sim.bags.conversions import Conversion, convert_bag  # noqa: PLC0415 (slow)
    from barc_sim.bags.reader import newest  # noqa: PLC0415 (slow: not for --help)

    bags = options.bags or [newest()]
    conversions = []
    for bag in bags:
        output = Path(f'{bag.resolve().stem}_csv')
        if options.output:
            output = options.output / output if len(bags) > 1 else options.output
        conversions.append(Conversion(bag, output, tuple(options.topics), tuple(options.exclude)))

    if len(bags) > 1 or options.scheduler is not None:
        return _convert_several(conversions, options)
    convert_bag(conversions[0])
    show(conversions[0].output)
    return 0


def _convert_several(conversions: list[Conversion], options: Namespace) -> int:
    """Convert bags, print where each is or why it failed, and return the exit code."""
    from barc_sim.bags.conversions import convert_bags  # noqa: PLC0415 (slow: not for --help)

    by_output: dict[Path, Conversion] = {}
    failures = {}
    for conversion in conversions:
        output = conversion.output.absolute()
        other = by_output.setdefault(output, conversion)
        if other is not conversion:
            failures[conversion.bag] = (
                f'its tables would be in the folder of those of {str(other.bag)!r}: convert it by '
                'itself, with --output'
            )

    absolute = [
        conversion._replace(
            bag=conversion.bag.absolute(),
            output=output,
            is_elsewhere=options.scheduler is not None,
        )
        for output, conversion in by_output.items()
    ]
    for output in by_output:
        output.parent.mkdir(parents=True, exist_ok=True)

    with interruptible_executor_of(options) as executor:
        for conversion, converted in convert_bags(absolute, executor):
            named = by_output[conversion.output]
            for warning in converted.warnings:
                show(f'{named.bag}: {warning}', error=True)
            if converted.failure:
                failures[named.bag] = converted.failure
            else:
                show(named.output)

    for bag, failure in failures.items():
        show(f'barc convert: {bag} could not be converted: {failure}', error=True)
    return 1 if failures else 0


def add_arguments_recover(parser: Parser) -> None:
    """Describe the command."""
    parser.description = (
        'Copy all readable messages of a damaged bag into a new one, with index, summary and '
        'metadata.yaml. Of a bag of several files, only the damaged ones are written anew.'
    )
    add_bag(parser)
    parser.add_argument(
        '-o',
        '--output',
        type=Path,
        metavar='DIR',
        help='directory of the new bag (BAG_recovered, beside BAG)',
    )


def run_recover(options: Namespace) -> None:
    """Write the new bag and print a summary of it."""
    from barc_sim.bags.recovery import recover  # noqa: PLC0415 (slow: not for --help)

    bag = _bag(options)
    whole = bag.resolve()
    output = options.output or whole.with_name(f'{whole.stem}_recovered')
    for line in _recovered(recover(bag, output)):
        show(line)
    show(output)


def _recovered(recovery: Recovery) -> Iterator[str]:
    """Yield the lines of the summary: damages, kept files, messages by topic."""
    yield from _damages({name: vars(damage) for name, damage in recovery.damages.items()})
    if recovery.linked:
        yield f'files that are whole, and now have a second name in the new bag: {recovery.linked}'
    if recovery.copied:
        yield f'files that are whole, and were copied: {recovery.copied}'
    for topic, count in recovery.counted:
        yield _topic_line(topic.name, topic.type, topic.message_encoding, count)
    yield f'{recovery.span.count:9} messages in {recovery.span.duration / 1e9:.3f} s'
