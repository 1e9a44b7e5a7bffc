"""The quality of service that a user sets for topics in a file, as `ros2 bag` reads it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from barc_sim.cli.limits import not_between
from barc_sim.cli.yaml_files import read_yaml
from barc_sim.errors import UserError

if TYPE_CHECKING:
    from pathlib import Path

_CHOICES = {
    'history': ('keep_last', 'keep_all', 'system_default'),
    'reliability': ('reliable', 'best_effort', 'system_default', 'best_available'),
    'durability': ('volatile', 'transient_local', 'system_default', 'best_available'),
    'liveliness': ('automatic', 'manual_by_topic', 'system_default', 'best_available'),
}
_DURATIONS = ('deadline', 'lifespan', 'liveliness_lease_duration')
_DEPTH = 'depth'
_RAW_NAME = 'avoid_ros_namespace_conventions'
_POLICIES = (*_CHOICES, *_DURATIONS, _DEPTH, _RAW_NAME)
_MAX_DEPTH = 2**31 - 1
_MAX_SECONDS = 9_223_372_036  # the seconds of the longest duration, 2^63 - 1 ns
_MAX_NANOSECONDS = 10**9 - 1


def read_qos_overrides(path: Path) -> dict[str, dict[str, Any]]:
    """Read the policies of topics from a YAML file.

    A topic has some of the policies of a QoS: history, depth, reliability, durability, deadline,
    lifespan, liveliness, liveliness_lease_duration, avoid_ros_namespace_conventions.

    Parameters
    ----------
    path
        The file.

    Returns
    -------
    dict
        By topic, the value of each policy that the file has, in rosbag2's terms: a duration has
        `sec` and `nsec`. Zero seconds stand for no limit.

    Raises
    ------
    UserError
        The file has another form, or a value that no policy has.
    OSError
        It cannot be read.
    """
    try:
        content = read_yaml(path)
        _check_mapping('the content', content, 'topics')
        return {name: _checked_profile(name, profile) for name, profile in content.items()}
    except UserError:  # it is no file
        raise
    except (TypeError, ValueError) as error:
        raise UserError(f'in {str(path)!r}, {error}') from None


def _checked_profile(topic: object, profile: Any) -> dict[str, Any]:  # noqa: ANN401 (any YAML)
    """Return the policies of a topic; ValueError: a name or a value is wrong."""
    if not isinstance(topic, str) or not topic.startswith('/'):
        raise ValueError(f"the topic {topic!r} does not begin with '/': give its full name")
    _check_mapping(topic, profile, 'policies')
    for policy, value in profile.items():
        why = _problem(policy, value)
        if why:
            raise ValueError(f'{policy} of {topic} {why}')
    return dict(profile)


def _check_mapping(what: str, value: object, keys: str) -> None:
    if not isinstance(value, dict):
        raise TypeError(f'{what} is {value!r}, where a mapping of {keys} is expected')


def _problem(policy: object, value: object) -> str:
    """Return what is wrong with a policy, as the end of a sentence; '' if nothing is."""
    if policy in _CHOICES:
        choices = _CHOICES[str(policy)]
        return '' if value in choices else f'is {value!r}: choose one of {", ".join(choices)}'
    if policy in _DURATIONS:
        return _problem_of_duration(value)
    if policy == _DEPTH:
        why = not_between(value, 0, _MAX_DEPTH)
        return f'is wrong: {why}' if why else ''
    if policy == _RAW_NAME:
        return '' if isinstance(value, bool) else f'is {value!r}: give true or false'
    return f'is no policy: choose from {", ".join(_POLICIES)}'


def _problem_of_duration(duration: Any) -> str:  # noqa: ANN401 (any YAML)
    """Return what is wrong with a duration; '' if nothing is."""
    if not isinstance(duration, dict) or duration.keys() != {'sec', 'nsec'}:
        return f"is {duration!r}: give 'sec' and 'nsec'"
    limits = {'sec': _MAX_SECONDS, 'nsec': _MAX_NANOSECONDS}
    for unit, limit in limits.items():
        why = not_between(duration[unit], 0, limit)
        if why:
            return f'has a wrong {unit!r}: {why}'
    return ''
