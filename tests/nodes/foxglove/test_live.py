"""The server of the Foxglove app where its SDK is missing."""

from __future__ import annotations

import pytest

pytest.importorskip('rclpy')

from barc_sim.errors import UserError
from barc_sim.nodes.foxglove import live


def test_sdk_that_is_missing_is_asked_for_in_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(live, 'foxglove', None)
    with pytest.raises(
        UserError, match=r'^the Foxglove SDK is not installed in this .*'
    ) as refusal:
        live.LiveServer(0)
    assert '\n' not in str(refusal.value)
    assert 'python -m pip install' in str(refusal.value)
