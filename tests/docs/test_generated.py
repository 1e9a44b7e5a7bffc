"""The generated reference has what the nodes, the messages and the parsers have."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from pytest import MonkeyPatch  # noqa: PT013

ROOT = Path(__file__).parents[2]


@pytest.fixture(autouse=True)
def _extensions(monkeypatch: MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(ROOT / 'docs' / '_ext')


def test_every_topic_and_service_has_a_meaning() -> None:
    import write_pages  # noqa: PLC0415

    lines = [*write_pages.topics(), *write_pages.services()]
    rows = [line.split(' | ') for line in lines if line.startswith('| `')]
    meanings = {row[0].strip('| `'): row[2].strip(' |') for row in rows}
    assert {'ecu', 'z_vhcl', '/clock', 'vehicle_simulator/reset'} <= meanings.keys()
    assert all(meanings.values()), meanings


def test_every_message_has_its_fields_with_units() -> None:
    import messages  # noqa: PLC0415

    for path in messages.MESSAGES.glob('*.msg'):
        about, fields = messages.message(path.read_text(encoding='utf-8'))
        assert about.endswith('.'), path
        assert all(comment for _, _, comment in fields), path
        numbers = [comment for kind, _, comment in fields if kind == 'float64']
        assert all(comment.startswith('[') for comment in numbers), path


@pytest.mark.parametrize('page', ['reference', 'instructors'])
def test_the_generated_parts_of_the_pages_are_fresh(
    page: str, ros_domain: int, monkeypatch: MonkeyPatch
) -> None:
    """`python docs/_ext/write_pages.py` renews them."""
    pytest.importorskip('rclpy')
    import write_pages  # noqa: PLC0415

    monkeypatch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', 'OFF')
    assert ros_domain
    paths = [path for path in write_pages.pages() if page in path.parts]
    assert paths
    for path in paths:
        text = path.read_text(encoding='utf-8')
        assert write_pages.filled(text) == text, f'{path}: run python docs/_ext/write_pages.py'


def test_the_search_for_names_leaves_out_what_is_for_developers() -> None:
    pytest.importorskip('sphinx')
    import reference  # noqa: PLC0415

    def directives(room: str) -> str:
        return '\n'.join(reference.Room.lines(SimpleNamespace(arguments=[room])))

    assert ':no-index:' not in directives('nodes')
    for room in ('page', 'runs', 'simulation'):
        assert directives(room).count(':no-index:') == directives(room).count('automodule') > 1
