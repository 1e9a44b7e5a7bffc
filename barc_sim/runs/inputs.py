"""Reads and checks the inputs of a run that its command line names, before nodes are made."""

from __future__ import annotations

from copy import copy
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from barc_sim.bags.directory import check_root
from barc_sim.control.cruise_control import DEFAULT_LANE, DEFAULT_TYPE, LANE_TYPES, TYPES
from barc_sim.control.speed import PID, set_gains
from barc_sim.errors import UserError
from barc_sim.lab.files import find_files
from barc_sim.lab.user_code.adapters import (
    UserCommands,
    UserController,
    UserLane,
    line_along,
    line_arguments,
)
from barc_sim.lab.user_code.code import UserCode
from barc_sim.vehicle.road import Road
from barc_sim.vehicle.track import Track

if TYPE_CHECKING:
    from argparse import Namespace
    from collections.abc import Iterable, Sequence

    from barc_sim.learning.tasks import Policy

_STEERING = ('lane', 'lane_gain')
_DRIVING = (*PID.gains, 'gain', 'controller_type', 'controller', 'identify')
_OF_TRACK = (*_STEERING, 'speed_profile')
_OF_SPEED = (*PID.gains, 'gain', 'controller_type', 'reference', 'speed', 'speed_profile')
_OF_CONTROLLER = (*_DRIVING, *_OF_TRACK, 'policy', 'acceleration_limit', 'reference')


class RunLaws(NamedTuple):
    """What decides in place of barc_sim's own laws; None: barc_sim's own."""

    speed: Any = None
    lane: Any = None


class RunInputs(NamedTuple):
    """The inputs of a run."""

    road: Road | None  #: of `--road`; None: the simulator's parameter names it
    track: Track | None  #: of `--track`; None: the nodes' parameter names it
    user_code: UserCode
    policy: Policy | None = None  #: drives instead of a controller

    def new_laws(self) -> RunLaws:
        """Return the laws of a car, which belong to it alone."""
        code = self.user_code
        speed: Any = None
        if code.identify:
            speed = UserCommands(code)
        elif code.controller:
            speed = UserController(code)

        if not self.track:
            return RunLaws(speed=copy(self.policy) or speed)
        lane: Any = copy(self.policy)
        if lane is None and code.lane:
            lane = UserLane(code)
        return RunLaws(speed=speed, lane=lane)


def read_inputs(options: Namespace) -> RunInputs:
    """Read the files, and check that a bag can be made.

    UserError: a file cannot be used, or options contradict one another.
    """
    road = Road.named(options.road) if options.road else None
    track_name = getattr(options, 'track', None)  # teleop has no tracks
    track = Track.named(track_name) if track_name else None
    if not options.no_bag:
        check_root(options.bag_dir)

    output = _discard if options.quiet else _print
    user_code = UserCode(_files(options), output=output).load()
    _refuse_contradictions(options, user_code, track)
    if user_code.raceline and track:
        track = line_along(track, user_code.raceline(*line_arguments(track)))

    inputs = RunInputs(road, track, user_code)
    if options.mode == 'acc':
        _check_laws(options, inputs)
    if getattr(options, 'policy', None):
        inputs = inputs._replace(policy=_policy(options, inputs))
    return inputs


def _print(text: str) -> None:
    """Print what user code prints."""
    print(text, end='')  # noqa: T201


def _discard(text: str) -> None:
    """Print nothing of user code."""


def _files(options: Namespace) -> dict[str, Path]:
    """Return the user's files, by part."""
    files: dict[str, Path] = {}
    if options.lab:
        files |= find_files(options.lab, options.parts)
    for part in (*options.parts, 'policy'):
        file = getattr(options, part, None)
        if isinstance(file, Path) and file.suffix != '.onnx':  # `--lane` takes names, too
            files[part] = file
    return files


class _Contradiction(NamedTuple):
    """Options and files that a run has no use for, if a condition holds."""

    applies: bool
    options: Sequence[str]  #: their names
    files: Sequence[str]  #: the parts of a lab
    reason: str  #: follows the option or file that was given


def _refuse_contradictions(options: Namespace, code: UserCode, track: Track | None) -> None:
    """Refuse options and files that the run has no use for, or that set the same twice."""
    for contradiction in _contradictions(options, code, track):
        if contradiction.applies:
            _refuse(
                options,
                code,
                contradiction.options,
                contradiction.files,
                contradiction.reason,
            )


def _contradictions(
    options: Namespace, code: UserCode, track: Track | None
) -> list[_Contradiction]:
    advice = 'give one of the two only'
    on_track = 'is for a track: give one, as in --track L'
    name_of_ours = "names one of barc_sim's, and"
    has_law = bool(code.controller or code.identify)
    of_driver = _STEERING if track else _DRIVING

    def has(option: str) -> bool:
        return bool(getattr(options, option, None))

    return [
        _Contradiction(not track, _OF_TRACK, (), on_track),
        _Contradiction(
            not (track or code.model or code.controller), (), ('lane', 'raceline'), on_track
        ),
        _Contradiction(
            has_law,
            ('controller_type',),
            (),
            f'{name_of_ours} --lab or --controller gives another: {advice}',
        ),
        _Contradiction(
            bool(code.identify),
            _OF_SPEED,
            ('controller',),
            f'and identify.py both drive: {advice}',
        ),
        _Contradiction(
            getattr(options, 'lane', None) == 'speed-mpc',
            _OF_SPEED,
            ('controller',),
            f'and speed-mpc both drive: {advice}',
        ),
        _Contradiction(
            bool(code.lane), ('lane',), (), f'{name_of_ours} --lab gives lane.py: {advice}'
        ),
        _Contradiction(
            has('reference'),
            ('speed', 'speed_profile'),
            (),
            f'and --reference both give the speed: {advice}',
        ),
        _Contradiction(has('policy'), of_driver, of_driver, f'and --policy both drive: {advice}'),
        _Contradiction(has('no_controller'), _OF_CONTROLLER, (), f'and --no-controller: {advice}'),
        _Contradiction(has('no_relay'), ('relay',), (), f'and --no-relay: {advice}'),
    ]


def _refuse(
    options: Namespace, code: UserCode, names: Iterable[str], parts: Iterable[str], reason: str
) -> None:
    """Refuse the options with these names and the files of these parts, if any is given."""
    for name in names:
        if getattr(options, name, None) not in (None, []):
            raise UserError(f'--{name.replace("_", "-")} {reason}')
    for part in parts:
        if part in code.paths:
            raise UserError(f'{code.paths[part].name} {reason}')


def _check_laws(options: Namespace, inputs: RunInputs) -> None:
    """Raise UserError for a gain that the run's laws do not have, or that is given twice."""
    code = inputs.user_code
    if inputs.track:
        lane: Any = UserLane(code) if code.lane else LANE_TYPES[options.lane or DEFAULT_LANE]()
        set_gains(lane, dict(options.lane_gain))

    for name, _ in options.gain:
        if getattr(options, name, None) is not None and name in PID.gains:
            raise UserError(f'--gain {name} and --{name} give the same: give one of the two only')

    set_gains(TYPES[options.controller_type or DEFAULT_TYPE](), gains(options))


def gains(options: Namespace) -> dict[str, float]:
    """Return the gains of the controller that the command line gives, by name."""
    values = {name: getattr(options, name) for name in PID.gains}
    of_pid = {name: value for name, value in values.items() if value is not None}
    return of_pid | dict(options.gain)


def _policy(options: Namespace, inputs: RunInputs) -> Policy:
    """Return the policy in the first environment whose observation it takes; set its speed."""
    from barc_sim.learning.tasks import OnnxPolicy, Policy  # noqa: PLC0415 (slow)

    file = options.policy
    function = OnnxPolicy(file) if file.suffix == '.onnx' else inputs.user_code.function('policy')

    arguments: dict[str, Any] = {'speed': options.speed}
    if options.acceleration_limit:
        arguments['acceleration_limit'] = options.acceleration_limit
    if inputs.track:
        tasks = ['Lane', 'Race']
        arguments['track'] = inputs.track
    else:
        tasks = ['Hills']
        arguments['road'] = inputs.road

    failures = []
    for task in tasks:
        try:
            policy = Policy(function, task, **arguments)
        except UserError as error:
            failures.append(f'in {task}-v0, {error}')
            continue
        if 'motor' in policy.task.actions:
            reason = 'and --policy both drive: give one of the two only'
            names = (*_DRIVING, 'reference', 'speed_profile')
            _refuse(options, inputs.user_code, names, _DRIVING, reason)
        if options.speed is None:
            options.speed = policy.task.speed
        return policy
    raise UserError(f'--policy {str(file)!r}: {"; ".join(failures)}')
