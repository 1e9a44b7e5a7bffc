"""Losses, counted from the numbers that publishers give their messages."""

from __future__ import annotations

from barc_sim.bags.losses import UNNUMBERED, Losses, as_metadata, summary

A, B = b'a' * 16, b'b' * 16


def test_gaps_add_up_for_each_publisher() -> None:
    losses = Losses()
    for publisher, number in ((A, 1), (B, 5), (A, 3), (B, 6), (A, 7), (B, 8)):
        losses.count(publisher, number)
    assert losses.by_publisher == {A: 1 + 3, B: 1}


def test_middleware_without_numbers_is_detected() -> None:
    losses = Losses()
    losses.count(A, UNNUMBERED)
    losses.count(A, UNNUMBERED)
    assert losses.unnumbered
    assert losses.by_publisher == {}


def test_metadata_have_the_losses_by_topic_and_node() -> None:
    lost = {'/b': {'talker': 3, 'other': 2}, '/a': {}, '/c': None}
    assert as_metadata(lost) == {
        'lost_messages': '5',
        'lost /b': '5 (2 of other, 3 of talker)',
        'lost /c': 'unknown: the middleware does not number its messages',
    }


def test_summary_has_a_line_for_each_topic_with_losses_or_left_out() -> None:
    unrecorded = {'/b as Text': 'its type is Number'}
    assert summary({'/a': 3}, {'/a': {'talker': 1}}, unrecorded).splitlines() == [
        'recorded 3 messages, lost 1',
        'lost /a: 1 (1 of talker)',
        'not recorded /b as Text: its type is Number',
    ]
