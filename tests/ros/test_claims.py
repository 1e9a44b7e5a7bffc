"""A topic is claimed by one process, until it ends."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from rclpy.node import Node

from barc_sim.errors import UserError
from barc_sim.ros.peers import claim, others_here

if TYPE_CHECKING:
    from rclpy.context import Context

HOLDER = Path(__file__).with_name('programs') / 'hold_topic.py'


def test_another_process_holds_its_claim_until_it_is_killed(ros: Context, ros_domain: int) -> None:
    node = Node('car', context=ros)
    assert not others_here(ros_domain)

    with subprocess.Popen(
        [sys.executable, HOLDER], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as holder:
        assert holder.stdout
        assert holder.stdout.readline() == 'held\n'
        assert others_here(ros_domain)
        with pytest.raises(UserError):
            claim(node, 'z_vhcl')

        holder.kill()
        holder.wait(timeout=200)
    assert not others_here(ros_domain)

    claim(node, 'z_vhcl').close()
