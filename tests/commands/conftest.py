"""Fixtures of the commands' tests."""

from __future__ import annotations

import pytest


@pytest.fixture
def impatient(monkeypatch: pytest.MonkeyPatch) -> None:
    """Wait a shorter time [s] for what is not in the ROS graph: all of it is in this process."""
    monkeypatch.setattr('barc_sim.ros.introspection._PATIENCE', 0.5)
    monkeypatch.setattr('barc_sim.ros.introspection._ALONE', 0.3)
    monkeypatch.setattr('barc_sim.ros.introspection._STEADY', 0.2)
