"""The file with the quality of service of topics."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import pytest

from barc_sim.bags.qos_overrides import read_qos_overrides
from barc_sim.errors import UserError

if TYPE_CHECKING:
    from pathlib import Path


def read(folder: Path, text: str) -> dict[str, dict[str, Any]]:
    """Return the overrides of a file with this text."""
    file = folder / 'qos.yaml'
    file.write_text(text, encoding='utf-8')
    return read_qos_overrides(file)


def test_every_policy_of_several_topics_is_read(tmp_path: Path) -> None:
    overrides = read(
        tmp_path,
        """
        /scan:
          history: keep_last
          depth: 10
          reliability: best_effort
          durability: volatile
          deadline: {sec: 0, nsec: 0}
          lifespan: {sec: 1, nsec: 500000000}
          liveliness: system_default
          liveliness_lease_duration:
            sec: 9223372036
            nsec: 854775807
          avoid_ros_namespace_conventions: false
        /map:
          durability: transient_local
        """,
    )
    assert overrides == {
        '/scan': {
            'history': 'keep_last',
            'depth': 10,
            'reliability': 'best_effort',
            'durability': 'volatile',
            'deadline': {'sec': 0, 'nsec': 0},
            'lifespan': {'sec': 1, 'nsec': 500_000_000},
            'liveliness': 'system_default',
            'liveliness_lease_duration': {'sec': 9_223_372_036, 'nsec': 854_775_807},
            'avoid_ros_namespace_conventions': False,
        },
        '/map': {'durability': 'transient_local'},
    }


@pytest.mark.parametrize(
    ('text', 'why'),
    [
        ('', 'the content is None, where a mapping of topics is expected'),
        ('/a: reliable', "/a is 'reliable', where a mapping of policies is expected"),
        ('a: {}', "the topic 'a' does not begin with '/': give its full name"),
        ('7: {}', "the topic 7 does not begin with '/': give its full name"),
        (
            '/a: {reliability: best}',
            (
                "reliability of /a is 'best': choose one of reliable, best_effort, system_default, "
                'best_available'
            ),
        ),
        (
            '/a: {history: [keep_all]}',
            "history of /a is ['keep_all']: choose one of keep_last, keep_all, system_default",
        ),
        (
            '/a: {reliable: true}',
            (
                'reliable of /a is no policy: choose from history, reliability, durability, '
                'liveliness, deadline, lifespan, liveliness_lease_duration, depth, '
                'avoid_ros_namespace_conventions'
            ),
        ),
        ('/a: {depth: -1}', 'depth of /a is wrong: -1 is not a whole number from 0 to 2147483647'),
        (
            '/a: {depth: true}',
            'depth of /a is wrong: True is not a whole number from 0 to 2147483647',
        ),
        ('/a: {deadline: 2}', "deadline of /a is 2: give 'sec' and 'nsec'"),
        ('/a: {deadline: {sec: 2}}', "deadline of /a is {'sec': 2}: give 'sec' and 'nsec'"),
        (
            '/a: {lifespan: {sec: 1, nsec: 1000000000}}',
            (
                "lifespan of /a has a wrong 'nsec': "
                '1000000000 is not a whole number from 0 to 999999999'
            ),
        ),
        (
            '/a: {avoid_ros_namespace_conventions: 1}',
            'avoid_ros_namespace_conventions of /a is 1: give true or false',
        ),
    ],
)
def test_a_wrong_value_is_one_sentence(tmp_path: Path, text: str, why: str) -> None:
    with pytest.raises(UserError) as error:
        read(tmp_path, text)
    assert str(error.value) == f"in '{tmp_path / 'qos.yaml'}', {why}"


def test_text_that_is_no_yaml_is_refused(tmp_path: Path) -> None:
    with pytest.raises(UserError, match=r"^in '.*qos.yaml', it is not YAML"):
        read(tmp_path, '/a: [')


def test_a_folder_is_refused(tmp_path: Path) -> None:
    with pytest.raises(UserError, match='is a folder, where a regular file is expected'):
        read_qos_overrides(tmp_path)
