"""The options of a recording."""

from __future__ import annotations

from argparse import ArgumentParser, Namespace

import pytest

from barc_sim.bags.recording_settings import Recording
from barc_sim.runs.recording_options import add_recording_options, recording


def parse(*arguments: str) -> Recording:
    parser = ArgumentParser()
    add_recording_options(parser)
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
    ],
)
def test_regular_expressions_choose_the_recorded_topics(
    arguments: tuple[str, ...], wanted: set[str]
) -> None:
    topics = ('/ecu', '/car2/ecu', '/rosout', '/_hidden', '/arm/_action/status')
    assert {topic for topic in topics if parse(*arguments).wants(topic)} == wanted


def test_without_options_everything_is_recorded_into_one_file() -> None:
    assert parse() == Recording() == recording(Namespace(speed=8.0))
