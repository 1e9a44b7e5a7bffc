"""Messages and their types as a bag has them: CDR with times; definitions, also without ROS.

Definitions come from the files installed with their packages or with barc_sim.

CDR is the encoding of DDS (OMG formal/2008-01-04, 15.3, PLAIN_CDR).
"""

from __future__ import annotations

import importlib.util
import os
import re
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from importlib.machinery import PathFinder
from pathlib import Path
from struct import Struct
from typing import TYPE_CHECKING, Any, NamedTuple

from barc_sim.cli.parser import did_you_mean
from barc_sim.errors import UserError

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from rosbags.typesys.store import Typestore

_NUMBERS = {f'{sign}int{bits}' for sign in ('', 'u') for bits in (8, 16, 32, 64)}
PRIMITIVES = {'bool', 'byte', 'char', 'float32', 'float64', 'string', 'wstring', *_NUMBERS}
_FIELD_TYPE = re.compile(r'(?:^|\n)\s*([a-zA-Z0-9_/]+)(?:\[[^\]]*\])?\s+')
# Definitions, with their comments, as `<package>/<name>.msg`: what a run without ROS records.
_SHIPPED = Path(__file__).with_name('msg')
# In a checkout the lab's own lie beside the package; in a wheel, with the others.
_CHECKOUT = Path(__file__).parents[2] / 'barc_interfaces' / 'msg'
_OURS = 'barc_interfaces'
_FIELD = re.compile(r'\s*([a-zA-Z]\w*(?:/\w+)?)(?:<=\d+)?(?:\[[^\]]*\])?\s+\w+\b(?!\s*=)')
_COMMENT = re.compile(r'\s*#.*')
_OF_ITS_PACKAGE = re.compile(r'(?m)^(\s*)([A-Z]\w*\b)(?!/)')
_DELIMITER = '=' * 80
_PARTS = {'srv': ('Request', 'Response'), 'action': ('Goal', 'Result', 'Feedback')}
#: Types that ROS derives from an action, and from any service, by the end of their name.
_GOAL = 'unique_identifier_msgs/UUID goal_id\n'
_DERIVED = {
    'FeedbackMessage': _GOAL + '{0}_Feedback feedback\n',
    'SendGoal_Request': _GOAL + '{0}_Goal goal\n',
    'SendGoal_Response': 'bool accepted\nbuiltin_interfaces/Time stamp\n',
    'GetResult_Request': _GOAL,
    'GetResult_Response': 'int8 status\n{0}_Result result\n',
}
_EVENT = """\
service_msgs/ServiceEventInfo info
{0}_Request[<=1] request
{0}_Response[<=1] response
"""


@dataclass(frozen=True, kw_only=True)
class Topic:
    """A bag's record of a topic."""

    name: str
    type: str  #: as in `std_msgs/msg/Header`
    definition: str  #: `ros2msg` schema with dependencies
    type_hash: str  #: as in `RIHS01_…`
    offered_qos: Sequence[Mapping[str, Any]]  #: of each publisher, in rosbag2's terms


@cache
def definition(type_name: str) -> str:
    """Return the `ros2msg` schema of a type: its definition and those of all that it refers to.

    The layout is rosbag2's: the type's own text first; then, depth first and by name, each
    dependency once, under a line of 80 `=` and its name as `MSG: std_msgs/Header`. LookupError: one
    of them is not installed.
    """
    package, _, rest = type_name.partition('/')
    kind, _, base = rest.partition('/')
    if not (package.isidentifier() and kind.isidentifier() and base.isidentifier()):
        raise LookupError(f'{type_name!r} is not the name of a type')
    seen = {type_name}

    def expand(name: str) -> str:
        text = _text(name)
        for dependency in sorted(_dependencies(text, name.partition('/')[0])):
            if dependency not in seen:
                seen.add(dependency)
                text += f'\n{_DELIMITER}\nMSG: {dependency}\n{expand(dependency)}'
        return text

    return expand(type_name)


def shipped() -> Iterator[tuple[str, Path]]:
    """Yield the name of each message type that barc_sim brings, and the file that defines it."""
    for path in (*_SHIPPED.glob('*/*.msg'), *_CHECKOUT.glob('*.msg')):
        package = path.parent.name if path.parent.parent == _SHIPPED else 'barc_interfaces'
        yield f'{package}/msg/{path.stem}', path


def _text(name: str) -> str:
    """Return the text of a type's definition: the installed one, else that of barc_sim."""
    package, *kinds, base = name.split('/')
    if kinds not in ([], ['msg']):
        return _text_of_part(package, kinds[0], base)
    brought = dict(shipped()).get(f'{package}/msg/{base}')
    try:
        path = share(package) / 'msg' / f'{base}.msg'
    except LookupError:
        if brought is None:
            raise
        path = brought
    return _read(name, path)


def _text_of_part(package: str, kind: str, base: str) -> str:
    """Return what ROS makes of a part of a service or an action, as in `SetBool_Request`."""
    stem, _, end = base.partition('_')
    of, last = f'{package}/{kind}/{base}'.rpartition('_')[::2]
    text = _read(f'{package}/{kind}/{base}', share(package) / kind / f'{stem}.{kind}')
    if last == 'Event':
        return _EVENT.format(of)
    if end in _DERIVED:
        return _DERIVED[end].format(f'{package}/{kind}/{stem}')
    parts = dict(zip(_PARTS.get(kind, ()), re.split(r'(?m)^---$\n?', text), strict=False))
    if end not in parts:
        raise LookupError(f'{package}/{kind}/{base} is no part of a service or an action')
    if not any(_FIELD.match(_COMMENT.sub('', line)) for line in parts[end].splitlines()):
        return 'uint8 structure_needs_at_least_one_member\n'
    return _OF_ITS_PACKAGE.sub(rf'\1{package}/\2', parts[end])


def _read(name: str, path: Path) -> str:
    if path.is_file():
        return path.read_text(encoding='utf-8')
    raise LookupError(f'{name!r} has no definition at {str(path)!r}')


def _dependencies(text: str, package: str) -> set[str]:
    """Return the message types among a definition's fields, as in `std_msgs/Header`."""
    names = set(_FIELD_TYPE.findall(text)) - PRIMITIVES
    return {name if '/' in name else f'{package}/{name}' for name in names}


@cache
def share(package: str) -> Path:
    """Return a package's share folder: `share/<package>` in a folder above its Python module.

    This works without AMENT_PREFIX_PATH, which ROS from wheels does not set: in a virtual
    environment, in /opt/ros and in a colcon workspace.
    """
    spec = None
    with suppress(ImportError):
        if package.isidentifier():  # what stands in for ROS has no share folder
            spec = PathFinder.find_spec(package) or importlib.util.find_spec(package)
    if spec is None or spec.origin is None:
        raise LookupError(f'the package {package!r} is not installed')
    for folder in Path(spec.origin).parents:
        share = folder / 'share' / package
        if share.is_dir():
            return share
    raise LookupError(f'no share/{package} is installed above {spec.origin!r}')


def installed() -> dict[str, Path]:
    """Return the file of each message and service type, barc_sim's own and the installed ones."""
    prefixes = os.environ.get('AMENT_PREFIX_PATH', '').split(os.pathsep)
    roots = [Path(prefix) / 'share' for prefix in prefixes if prefix]
    with suppress(LookupError):
        roots.append(share(_OURS).parent)
    found = dict(shipped())
    for root in roots:
        for kind in ('msg', 'srv'):
            for path in root.glob(f'*/{kind}/*.{kind}'):
                found[f'{path.parents[1].name}/{kind}/{path.stem}'] = path
    return dict(sorted(found.items()))


def find_type(name: str) -> str:
    """Return the full name of a type: of `ECU`, `barc_interfaces/ECU` or itself."""
    known = installed()
    if name in known:
        return name
    found = [full for full in known if name in _short_names(full)]
    ours = [full for full in found if full.startswith(f'{_OURS}/')]
    if len(ours or found) == 1:
        return (ours or found)[0]
    if found:
        raise UserError(f'{name!r} is the name of several types: name one of {", ".join(found)}')
    names = {short for full in known for short in (*_short_names(full), full)}
    same = [each for each in names if each.lower() == name.lower()]
    ends = f': did you mean {same[0]}?' if same else did_you_mean(name, names)
    own = ', '.join(_short_names(full)[0] for full in known if full.startswith(f'{_OURS}/'))
    raise UserError(f'there is no message or service {name!r}{ends or f": {_OURS} has {own}"}')


def _short_names(full: str) -> tuple[str, str]:
    package, _, base = full.split('/')
    return base, f'{package}/{base}'


def definition_lines(name: str) -> Iterator[str]:
    """Yield the lines of the definition of `name`, with those of its fields' types indented.

    Comments are those of the type itself.
    """
    yield from _lines_of(installed(), name, 0)


def _lines_of(known: dict[str, Path], name: str, depth: int) -> Iterator[str]:
    for line in known[name].read_text(encoding='utf-8').splitlines():
        text = _COMMENT.sub('', line) if depth else line
        if text or not depth:
            yield ('\t' * depth + text).rstrip()
        field = _FIELD.match(_COMMENT.sub('', line))
        if field and field[1] not in PRIMITIVES:
            package, _, base = field[1].rpartition('/')
            nested = f'{package or name.partition("/")[0]}/msg/{base}'
            if nested in known:
                yield from _lines_of(known, nested, depth + 1)


NANOSECONDS = 1_000_000_000

_STAMP = slice(4, 12)
_LAST = 2**31 - 1  #: [s]
_TIMES = (Struct('>iI'), Struct('<iI'))  # big-endian, little-endian

#: The QoS that ROS reports of a publisher of another participant, in rosbag2's terms.
_ENDLESS = {'sec': 9_223_372_036, 'nsec': 854_775_807}
#: `/rosout` is latched for ten seconds.
_QOS_OF = {'/rosout': {'durability': 'transient_local', 'lifespan': {'sec': 10, 'nsec': 0}}}
_OFFERED_QOS = {
    'history': 'unknown',
    'depth': 0,
    'reliability': 'reliable',
    'durability': 'volatile',
    'deadline': _ENDLESS,
    'lifespan': _ENDLESS,
    'liveliness': 'automatic',
    'liveliness_lease_duration': _ENDLESS,
    'avoid_ros_namespace_conventions': False,
}


class Message(NamedTuple):
    """A message to write."""

    topic: Topic
    data: bytes  #: in CDR, with its header
    received: int  #: [ns] since the epoch
    published: int  #: [ns] since the epoch
    number: int  #: the publisher's count


#: Those of a `Message`, which takes 0.3 us to make.
MessageFields = tuple[Topic, bytes, int, int, int]


def leading_time(data: bytes) -> int:
    """Return the time [ns] at the start of a serialized message: a header's stamp, or a clock."""
    sec, nanosec = _TIMES[data[1] & 1].unpack(data[_STAMP])
    return int(sec) * NANOSECONDS + int(nanosec)


def split_time(stamp: int) -> tuple[int, int]:
    """Return a time [ns] as seconds and nanoseconds; the inverse of `leading_time`.

    Nanoseconds beyond a second stay where the seconds are at their end, as a stranger may send it.
    """
    sec, nanosec = divmod(stamp, NANOSECONDS)
    return (sec, nanosec) if sec <= _LAST else (_LAST, stamp - _LAST * NANOSECONDS)


@cache
def _types() -> Typestore:
    """Return the types whose definitions are shipped with barc_sim."""
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore  # noqa: PLC0415 (100 ms)

    store = get_typestore(Stores.EMPTY)
    types: dict[str, Any] = {}
    for name, path in shipped():
        types |= get_types_from_msg(path.read_text(encoding='utf-8'), name)
    store.register(types)
    return store


def field_types(type_name: str) -> Mapping[str, Any]:
    """Return the fields of a shipped type with rosbags' descriptions; none of another type."""
    return dict(_types().fielddefs.get(type_name, ((), ()))[1])


def topic(name: str, type_name: str, store: Typestore | None = None) -> Topic:
    """Return a bag's record of a topic that a run publishes without ROS.

    What is neither installed nor shipped has its definition from `store`.
    """
    store = store or _types()
    try:
        text = definition(type_name)
    except LookupError:
        text, _ = store.generate_msgdef(type_name, ros_version=2)
    return Topic(
        name=name,
        type=type_name,
        definition=text,
        type_hash=store.hash_rihs01(type_name),
        offered_qos=[_OFFERED_QOS | _QOS_OF.get(name, {})],
    )
