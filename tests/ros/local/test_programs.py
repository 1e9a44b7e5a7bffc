"""The same programs print the same on rclpy over DDS and on what stands in for it."""

from __future__ import annotations

import ast
import subprocess
import sys
from pathlib import Path

import pytest

_FILE = Path(__file__).with_name('programs.py')
PROGRAMS = [
    node.name
    for node in ast.parse(_FILE.read_text(encoding='utf-8')).body
    if isinstance(node, ast.FunctionDef) and node.name not in ('spin', 'attempt', 'wait_for')
]


def run(carrier: str) -> dict[str, str]:
    """Return what each program prints on a carrier."""
    done = subprocess.run(
        [sys.executable, '-W', 'ignore', str(_FILE), carrier],
        capture_output=True,
        text=True,
        check=False,
        timeout=200,
    )
    sections = (section.partition('\n') for section in done.stdout.split('== ')[1:])
    return {name: text for name, _, text in sections} | {'stderr': done.stderr}


@pytest.fixture(scope='module')
def printed(module_domain: int) -> dict[str, dict[str, str]]:
    del module_domain
    return {carrier: run(carrier) for carrier in ('ros', 'local')}


@pytest.mark.parametrize('program', PROGRAMS)
def test_a_program_prints_the_same_with_and_without_ros(
    printed: dict[str, dict[str, str]], program: str
) -> None:
    assert program in printed['local'], printed['local']['stderr']
    assert printed['local'][program] == printed['ros'][program]
    assert 'Traceback' not in printed['local'][program]
