"""The options of a recording."""

from __future__ import annotations

from argparse import ArgumentError, ArgumentParser, Namespace
from typing import TYPE_CHECKING

import pytest

from barc_sim.bags.recording_settings import Recording
from barc_sim.errors import UserError
from barc_sim.runs.recording_options import (
    add_control_options,
    add_qos_overrides,
    add_recording_options,
    add_selection_options,
    recording,
)

if TYPE_CHECKING:
    from pathlib import Path


def parse(*arguments: str) -> Recording:
    parser = ArgumentParser(exit_on_error=False)
    add_recording_options(parser)
    add_selection_options(parser)
    add_control_options(parser)
    add_qos_overrides(parser, 'record')
    return recording(parser.parse_args(arguments))


@pytest.mark.parametrize(
    ('arguments', 'wanted'),
    [
        ((), {'/ecu', '/car2/ecu', '/rosout'}),
        (('--topics', 'ecu'), {'/ecu', '/car2/ecu'}),
        (('--topics', '^/ecu$|rosout'), {'/ecu', '/rosout'}),
        (('--exclude', '^/car2'), {'/ecu', '/rosout'}),
        (('--topics', 'ecu', '--exclude', '^/car2'), {'/ecu'}),
        (('--exclude', '^/car2', '--exclude', 'rosout'), {'/ecu'}),
        (('--topics', '/_'), {'/_hidden', '/arm/_action/status'}),
        (('--include-hidden-topics', '-x', 'ecu'), {'/rosout', '/_hidden', '/arm/_action/status'}),
        (('--topic-types', 'rcl_interfaces/msg/Log'), {'/rosout'}),
        (('--topic-types', 'rcl_interfaces/msg/Log', '--topics', '^/ecu'), {'/rosout', '/ecu'}),
        (('--exclude-topic-types', 'barc_interfaces/msg/ECU'), {'/rosout'}),
    ],
)
def test_topics_are_chosen_by_name_and_type(arguments: tuple[str, ...], wanted: set[str]) -> None:
    topics = {
        '/ecu': 'barc_interfaces/msg/ECU',
        '/car2/ecu': 'barc_interfaces/msg/ECU',
        '/rosout': 'rcl_interfaces/msg/Log',
        '/_hidden': 'std_msgs/msg/Float64',
        '/arm/_action/status': 'action_msgs/msg/GoalStatusArray',
    }
    chosen = parse(*arguments)
    assert {name for name, kind in topics.items() if chosen.wants(name, [kind])} == wanted


def test_without_options_everything_is_recorded_into_one_file() -> None:
    assert parse() == Recording() == recording(Namespace(speed=8.0))


def test_rosbag2s_names_set_when_a_file_ends_and_how_it_is_stored() -> None:
    short = parse('-b', '1024', '-d', '60')
    assert short == parse('--max-bag-size', '1024', '--max-bag-duration', '60')
    assert short == Recording(max_bag_size=1024, max_bag_duration=60.0)
    assert parse('--compression-format', 'lz4') == Recording(compression_format='lz4')
    preset = parse('--storage-preset-profile', 'fastwrite')
    assert preset == Recording(storage_preset_profile='fastwrite')


def test_start_paused_and_snapshots() -> None:
    settings = parse('--start-paused', '--snapshot-mode', '--max-cache-size', '1000')
    assert settings == Recording(start_paused=True, snapshot_mode=True, max_cache_size=1000)
    with pytest.raises(UserError, match='a snapshot needs a cache'):
        parse('--snapshot-mode', '--max-cache-size', '0')


def test_quality_of_service_is_read_from_a_file(tmp_path: Path) -> None:
    file = tmp_path / 'qos.yaml'
    file.write_text('/scan: {reliability: best_effort}', encoding='utf-8')
    settings = parse('--qos-profile-overrides-path', str(file))
    assert settings.qos_overrides == {'/scan': {'reliability': 'best_effort'}}


@pytest.mark.parametrize(
    ('arguments', 'why'),
    [
        (('--topic-types', 'Float64'), "'Float64' is not the name of a type, as in std_msgs/msg/"),
        (('-b', '-1'), '-1 is not a whole number from 0 to'),
        (('-b', '1000'), '1000 is too small: give 0 or at least 1024'),
        (('-d', 'minute'), "'minute' is not a number from 0 to"),
        (('--storage-preset-profile', ''), 'invalid choice'),
        (('--topics', '('), r"'\(' is not a regular expression"),
        (('--qos-profile-overrides-path', '/'), "'/' is a folder"),
    ],
)
def test_a_wrong_value_is_refused(arguments: tuple[str, ...], why: str) -> None:
    with pytest.raises(ArgumentError, match=why):
        parse(*arguments)
