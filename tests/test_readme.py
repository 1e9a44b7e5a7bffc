"""README's tables name what there is: options, parameters with their defaults, topics."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from barc_sim.nodes.controller import CruiseController
from barc_sim.nodes.mirrors.node import MirrorNode
from barc_sim.nodes.simulator.node import VehicleSimulator
from barc_sim.ros import names

if TYPE_CHECKING:
    from collections.abc import Callable

    from rclpy.context import Context
    from rclpy.node import Node

ROOT = Path(__file__).parents[1]
README = (ROOT / 'README.md').read_text(encoding='utf-8')
BUILT_IN = {'use_sim_time', 'start_type_description_service'}


def table(heading: str) -> str:
    """Return the first table behind `heading`."""
    text = README.split(heading, 1)[1]
    return text[text.index('\n|') : text.index('\n\n', text.index('\n|'))]


@pytest.mark.parametrize('create', [VehicleSimulator, CruiseController, MirrorNode])
def test_parameters_are_listed_with_their_defaults(
    ros: Context, create: Callable[..., Node]
) -> None:
    node = create(context=ros)
    known = set(node.list_parameters(prefixes=[], depth=0).names) - BUILT_IN
    declared = {name: str(node.get_parameter(name).value) for name in known}
    heading = f'`{node.get_name()}`,'
    node.destroy_node()
    listed: dict[str, str] = {}
    for row in table(heading).splitlines()[3:]:
        first, second, _ = row.strip('|').split('|')
        found, values = re.findall(r'`(\w+)`', first), second.strip().split(', ')
        listed |= dict(zip(found, values * (len(found) // len(values)), strict=True))
    assert {name: value.capitalize() for name, value in listed.items()} == {
        name: value.capitalize() for name, value in declared.items()
    }


def test_topics_are_listed() -> None:
    listed = re.findall(r'^\| `([\w/]+)` \|', table('## Topics'), re.MULTILINE)
    constants = [each for name, each in vars(names).items() if name.isupper()]
    topics = {each for each in constants if isinstance(each, str) and '/' not in each[1:]}
    assert set(listed) == topics


def test_options_of_the_run_are_listed() -> None:
    command = [sys.executable, '-m', 'barc_sim.run', 'acc', '--help']
    told = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True).stdout
    offered = set(re.findall(r'--[a-z][a-z-]+', told.split('options:')[1])) - {'--help'}
    named = ''.join(row.split('|')[1] for row in table('## Options').splitlines()[3:])
    assert offered == set(re.findall(r'--[a-z][a-z-]+', named))


def test_pictures_and_files_that_it_names_are_there() -> None:
    for path in re.findall(r'\]\(([\w/.]+)\)', README):
        assert (ROOT / path).is_file(), path
