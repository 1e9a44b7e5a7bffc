"""Losses, counted from the numbers that publishers give their messages."""

from __future__ import annotations

from barc_sim.bags.losses import UNNUMBERED, Losses, as_metadata, summary

A, B = b'a' * 16, b'b' * 16


def test_nothing_is_lost_where_numbers_follow_one_another() -> None:
    losses = Losses()
    for number in (7, 8, 9):
        losses.count(A, number)
    assert losses.by_publisher == {}


def test_gaps_add_up_for_each_publisher() -> None:
    losses = Losses()
    for publisher, number in ((A, 1), (B, 5), (A, 3), (B, 6), (A, 7), (B, 8)):
        losses.count(publisher, number)
    assert losses.by_publisher == {A: 1 + 3, B: 1}


def test_a_middleware_without_numbers_is_noticed() -> None:
    losses = Losses()
    losses.count(A, UNNUMBERED)
    losses.count(A, UNNUMBERED)
    assert losses.unnumbered
    assert losses.by_publisher == {}


def test_a_bag_says_of_each_topic_what_was_lost_of_whom() -> None:
    lost = {'/b': {'talker': 3, 'other': 2}, '/a': {}, '/c': None}
    assert as_metadata(lost) == {
        'lost_messages': '5',
        'lost /b': '5 (2 of other, 3 of talker)',
        'lost /c': 'unknown: the middleware does not number its messages',
    }


def test_no_loss_is_said_too() -> None:
    assert summary({'/a': 3, '/b': 4}, {'/a': {}}) == 'recorded 7 messages, lost 0'


def test_loss_is_said_in_a_line_of_its_own() -> None:
    assert summary({'/a': 3}, {'/a': {'talker': 1}}).splitlines() == [
        'recorded 3 messages, lost 1',
        'lost /a: 1 (1 of talker)',
    ]
