"""A topic for one publisher, and a domain for one process."""

from __future__ import annotations

import subprocess
import sys
from typing import TYPE_CHECKING

import pytest

pytest.importorskip('rclpy')

from rclpy.node import Node

from barc_sim.errors import UserError
from barc_sim.ros.peers import claim, others_here

if TYPE_CHECKING:
    from rclpy.context import Context

HOLDER = """
import rclpy
from rclpy.node import Node
from barc_sim.ros.peers import claim
rclpy.init()
node = Node('holder')
held = claim(node, 'z_vhcl')
print('held', flush=True)
input()
"""


def test_another_process_and_its_claim_are_known_until_it_is_killed(
    ros: Context, ros_domain: int
) -> None:
    node = Node('car', context=ros)
    assert not others_here(ros_domain)
    with subprocess.Popen(
        [sys.executable, '-c', HOLDER], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as holder:
        assert holder.stdout
        assert holder.stdout.readline() == 'held\n'
        assert others_here(ros_domain)
        with pytest.raises(UserError):
            claim(node, 'z_vhcl')
        holder.kill()
        holder.wait(timeout=20)
    assert not others_here(ros_domain)
    claim(node, 'z_vhcl').close()


def test_topics_of_other_namespaces_are_free_however_long(ros: Context) -> None:
    namespaces = ['', 'a', 'b', *(letter * 150 for letter in 'ab')]
    nodes = [Node('car', namespace=namespace, context=ros) for namespace in namespaces]
    held = [claim(node, 'z_vhcl') for node in nodes]
    with pytest.raises(UserError):
        claim(nodes[-1], 'z_vhcl')
    for one in held:
        one.close()
