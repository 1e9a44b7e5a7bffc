"""Reads and checks the inputs of a run that its command line names, before nodes are made."""

from __future__ import annotations

from copy import copy
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from barc_sim.bags.recording import check_root
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
    from collections.abc import Iterable

    from barc_sim.learning.tasks import Policy

_STEERING = ('lane', 'lane_gain')
_DRIVING = (*PID.gains, 'gain', 'controller_type', 'controller', 'identify')
_OF_TRACK = (*_STEERING, 'speed_profile')
_OF_SPEED = (*PID.gains, 'gain', 'controller_type', 'reference', 'speed', 'speed_profile')
_OF_CONTROLLER = (*_DRIVING, *_OF_TRACK, 'policy', 'acceleration_limit', 'reference')


class Inputs(NamedTuple):
    """The inputs of a run."""

    road: Road | None  #: of `--road`; None: the simulator's parameter names it
    track: Track | None  #: of `--track`; None: the nodes' parameter names it
    user_code: UserCode
    policy: Policy | None = None  #: drives instead of a controller

    def laws(self) -> tuple[Any, Any]:
        """Return the user's speed controller and steering law, both new; None: barc_sim's own."""
        controller: Any = None
        code, policy = self.user_code, copy(self.policy)
        if code.identify:
            controller = UserCommands(code)
        elif code.controller:
            controller = UserController(code)
        if self.track:
            return controller, policy or (UserLane(code) if code.lane else None)
        return policy or controller, None


def read_inputs(options: Namespace) -> Inputs:
    """Read the files, and check that a bag can be made.

    UserError: a file cannot be used, or options contradict one another.
    """
    road = Road.named(options.road) if options.road else None
    track = getattr(options, 'track', None) and Track.named(options.track)
    if not options.no_bag:
        check_root(options.bag_dir)
    output = (lambda _: None) if options.quiet else partial(print, end='')
    user_code = UserCode(_files(options), output=output).load()
    _refuse_contradictions(options, user_code, track)
    if user_code.raceline and track:
        track = line_along(track, user_code.raceline(*line_arguments(track)))
    inputs = Inputs(road, track, user_code)
    if options.mode == 'acc':
        _check_laws(options, inputs)
    if getattr(options, 'policy', None):
        inputs = inputs._replace(policy=_policy(options, inputs))
    return inputs


def _files(options: Namespace) -> dict[str, Path]:
    """Return the user's files, by part."""
    named = {part: getattr(options, part, None) for part in (*options.parts, 'policy')}
    return (find_files(options.lab, options.parts) if options.lab else {}) | {
        part: file
        for part, file in named.items()
        if isinstance(file, Path) and file.suffix != '.onnx'
    }


def _refuse_contradictions(options: Namespace, code: UserCode, track: Track | None) -> None:
    """Refuse options and files that the run has no use for, or that set the same twice."""
    one, option = 'give one of the two only', vars(options).get
    on_track, ours = 'is for a track: give one, as in --track L', "names one of barc_sim's, and"
    has_law = code.controller or code.identify
    driven, both = _STEERING if track else _DRIVING, f'both drive: {one}'
    for applies, names, parts, why in (
        (not track, _OF_TRACK, (), on_track),
        (not (track or code.model or code.controller), (), ('lane', 'raceline'), on_track),
        (has_law, ('controller_type',), (), f'{ours} --lab or --controller gives another: {one}'),
        (code.identify, _OF_SPEED, ('controller',), f'and identify.py {both}'),
        (option('lane') == 'speed-mpc', _OF_SPEED, ('controller',), f'and speed-mpc {both}'),
        (code.lane, ('lane',), (), f'{ours} --lab gives lane.py: {one}'),
        (
            option('reference'),
            ('speed', 'speed_profile'),
            (),
            f'and --reference both give the speed: {one}',
        ),
        (option('policy'), driven, driven, f'and --policy {both}'),
        (option('no_controller'), _OF_CONTROLLER, (), f'and --no-controller: {one}'),
        (option('no_relay'), ('relay',), (), f'and --no-relay: {one}'),
    ):
        if applies:
            _refuse(options, code, names, parts, why)


def _refuse(
    options: Namespace, code: UserCode, names: Iterable[str], parts: Iterable[str], why: str
) -> None:
    """Refuse the options with these names and the files of these parts, if any is given."""
    refused = [
        f'--{name.replace("_", "-")}'
        for name in names
        if getattr(options, name, None) not in (None, [])
    ]
    refused += [code.paths[part].name for part in parts if part in code.paths]
    if refused:
        raise UserError(f'{refused[0]} {why}')


def _check_laws(options: Namespace, inputs: Inputs) -> None:
    """Raise UserError for a gain that the run's laws do not have, or that is given twice."""
    code = inputs.user_code
    if inputs.track:
        law: Any = UserLane(code) if code.lane else LANE_TYPES[options.lane or DEFAULT_LANE]()
        set_gains(law, dict(options.lane_gain))
    for name, _ in options.gain:
        if getattr(options, name, None) is not None and name in PID.gains:
            raise UserError(f'--gain {name} and --{name} give the same: give one of the two only')
    set_gains(TYPES[options.controller_type or DEFAULT_TYPE](), gains(options))


def gains(options: Namespace) -> dict[str, float]:
    """Return the gains of the controller that the command line gives, by name."""
    named = {name: getattr(options, name) for name in PID.gains}
    return {name: value for name, value in named.items() if value is not None} | dict(options.gain)


def _policy(options: Namespace, inputs: Inputs) -> Policy:
    """Return the policy in the first environment whose observation it takes; set its speed."""
    from barc_sim.learning.tasks import OnnxPolicy, Policy  # noqa: PLC0415 (slow)

    file, arguments = options.policy, {'speed': options.speed}
    if options.acceleration_limit:
        arguments['acceleration_limit'] = options.acceleration_limit
    arguments |= {'track': inputs.track} if inputs.track else {'road': inputs.road}
    function = OnnxPolicy(file) if file.suffix == '.onnx' else inputs.user_code.function('policy')
    failures = []
    for task in ('Lane', 'Race') if inputs.track else ('Hills',):
        try:
            policy = Policy(function, task, **arguments)
        except UserError as error:
            failures.append(f'in {task}-v0, {error}')
            continue
        if 'motor' in policy.task.actions:
            why = 'and --policy both drive: give one of the two only'
            names = (*_DRIVING, 'reference', 'speed_profile')
            _refuse(options, inputs.user_code, names, _DRIVING, why)
        if options.speed is None:
            options.speed = policy.task.speed
        return policy
    raise UserError(f'--policy {str(file)!r}: {"; ".join(failures)}')
