"""Where bags are made, and the messages that they lack."""

from __future__ import annotations

import os
import re
from pathlib import Path

import pytest

from barc_sim.bags.directory import check_root, check_space, make_directory
from barc_sim.bags.losses import UNNUMBERED, Losses, Missing
from barc_sim.errors import UserError


def test_directory_is_named_after_date_and_time_in_a_folder_made_for_it(tmp_path: Path) -> None:
    directory = make_directory(None, tmp_path / 'my' / 'bags')
    assert directory.is_dir()
    assert directory.parent == tmp_path / 'my' / 'bags'
    assert re.fullmatch(r'\d{4}-\d\d-\d\d_\d\d-\d\d-\d\d', directory.name)


def test_runs_in_one_second_get_directories_of_their_own(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr('time.strftime', lambda _: '2026-01-01_00-00-00')
    names = [make_directory(None, tmp_path).name for _ in range(3)]
    assert names == ['2026-01-01_00-00-00', '2026-01-01_00-00-00_2', '2026-01-01_00-00-00_3']


def test_a_folder_without_write_permission_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # Root may write anywhere, so that a folder's mode alone would show nothing here.
    monkeypatch.setattr(os, 'access', lambda path, mode: Path(path) != tmp_path or not mode)
    with pytest.raises(UserError, match=f"as '{tmp_path}' is not writable"):
        check_root(tmp_path / 'bags')


def test_a_directory_that_the_system_refuses_is_one_sentence(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*_: object, **__: object) -> None:
        raise OSError(28, 'No space left on device')

    monkeypatch.setattr(Path, 'mkdir', refuse)
    with pytest.raises(UserError, match=r'cannot be made \(No space left on device\)'):
        make_directory(None, tmp_path / 'bags')


def test_a_broken_link_is_refused_as_a_folder_for_bags(tmp_path: Path) -> None:
    (tmp_path / 'bags').symlink_to(tmp_path / 'gone')
    with pytest.raises(UserError, match=r'\(File exists\): name another folder'):
        make_directory(None, tmp_path / 'bags')


def test_too_little_space_is_one_sentence(tmp_path: Path) -> None:
    check_space(tmp_path / 'new', 0)
    with pytest.raises(UserError, match=r'MiB are free, and 1.1259e\+15 MiB must stay free: make'):
        check_space(tmp_path / 'new' / 'bags', 2**70)
    assert not (tmp_path / 'new').exists()


A, B = b'a' * 16, b'b' * 16


def test_gaps_add_up_for_each_publisher() -> None:
    losses = Losses()
    for publisher, *numbers in ((A, 1), (B, 5), (A, 3, 4), (B, 6), (A, 7, 9), (B, 8)):
        losses.count(publisher, numbers)
    assert losses.by_publisher == {A: 1 + 2 + 1, B: 1}


def test_middleware_without_numbers_is_detected() -> None:
    losses = Losses()
    losses.count(A, [UNNUMBERED, UNNUMBERED])
    assert losses.unnumbered
    assert losses.by_publisher == {}


def test_metadata_have_the_losses_by_topic_and_node() -> None:
    unknown = {'/b': 'nobody counts', '/c': 'nobody counts'}
    missing = Missing(lost={'/b': {'talker': 3, 'other': 2}, '/a': {}}, unknown=unknown)
    assert missing.as_metadata() == {
        'lost_messages': '5',
        'lost /b': '5 (2 of other, 3 of talker); unknown: nobody counts',
        'lost /c': 'unknown: nobody counts',
    }


def test_summary_has_a_line_for_each_topic_with_losses_or_left_out() -> None:
    left_out = {'/b as Text': 'its type is Number'}
    missing = Missing(lost={'/a': {'talker': 1}}, left_out=left_out, before_clock=4)
    assert missing.summary({'/a': 3}).splitlines() == [
        'recorded 3 messages, lost 1',
        'lost /a: 1 (1 of talker)',
        'not recorded /b as Text: its type is Number',
        'not recorded before /clock: 4 messages',
    ]


def test_summary_claims_no_more_than_is_known() -> None:
    missing = Missing(lost={'/a': {}}, unknown={'/a': 'nobody counts'})
    assert missing.summary({}).splitlines() == [
        'recorded 0 messages, lost 0 or more',
        'lost /a: unknown: nobody counts',
    ]
