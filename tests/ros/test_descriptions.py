"""Every parameter says what it is."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

pytest.importorskip('rclpy')

from barc_sim.control.keyboard import PARAMETERS as KEYBOARD
from barc_sim.nodes.controller import CruiseController
from barc_sim.nodes.recorder import BagRecorder
from barc_sim.nodes.relay import Relay
from barc_sim.nodes.simulator import VehicleSimulator
from barc_sim.nodes.view import ViewNode

if TYPE_CHECKING:
    from pathlib import Path

    from rclpy.context import Context
    from rclpy.node import Node

#: rclpy's own; it describes one of the two.
BUILT_IN = {'start_type_description_service', 'use_sim_time'}


@pytest.mark.parametrize('kind', [CruiseController, Relay, VehicleSimulator, ViewNode, BagRecorder])
def test_parameter_of_a_node_has_a_description(
    ros: Context, tmp_path: Path, kind: type[Node]
) -> None:
    where = {'directory': tmp_path} if kind is BagRecorder else {}
    node = kind(context=ros, **where)
    try:
        names = set(node.list_parameters(prefixes=[], depth=0).names) - BUILT_IN
        assert names
        missing = [name for name in names if not node.describe_parameter(name).description.strip()]
        assert missing == []
    finally:
        if isinstance(node, BagRecorder):
            node.close()
        node.destroy_node()


def test_parameters_of_the_keyboard_have_descriptions() -> None:
    assert all(parameter.description for parameter in KEYBOARD)
