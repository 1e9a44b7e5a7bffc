"""What the nodes say that they subscribe to, which a run records from its start."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import pytest

from barc_sim.nodes.controller import CruiseController
from barc_sim.nodes.mirror import MirrorNode
from barc_sim.nodes.relay import Relay
from barc_sim.nodes.simulator import VehicleSimulator

if TYPE_CHECKING:
    from rclpy.context import Context


@pytest.mark.parametrize('kind', [CruiseController, MirrorNode, Relay, VehicleSimulator])
def test_the_inputs_of_a_node_are_its_subscriptions(ros: Context, kind: Any) -> None:  # noqa: ANN401
    node = kind(context=ros)
    subscribed = {each.topic_name: each.msg_type for each in node.subscriptions}
    node.destroy_node()
    assert subscribed == {f'/{name}': message_type for name, message_type in kind.inputs.items()}
