"""A student's `compose.py`, which is run for some seconds."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from command_line import printed

import barc_sim.lab
from barc_sim.runs import compose_check
from barc_sim.runs.compose_check import Verdict, judge_composition

if TYPE_CHECKING:
    from collections.abc import Callable

TEMPLATE = (Path(barc_sim.lab.__file__).parent / 'templates' / 'hills' / 'compose.py').read_text()
#: The template, finished.
RIGHT = TEMPLATE.replace(
    '    raise NotImplementedError',
    '    return [BagRecorder(), VehicleSimulator(), Relay(), Keyboard(Terminal())]',
    1,
).replace(
    '    raise NotImplementedError',
    '    nodes = make_nodes()\n'
    '    executor = MultiThreadedExecutor()\n'
    '    for node in nodes:\n'
    '        executor.add_node(node)\n'
    '    try:\n'
    '        executor.spin()\n'
    '    except KeyboardInterrupt:\n'
    '        pass\n'
    '    finally:\n'
    '        for node in nodes:\n'
    '            node.destroy_node()',
)


@pytest.fixture
def judged(tmp_path: Path) -> Callable[[str], Verdict]:
    """Return what judges the text of a script."""

    def judge(text: str) -> Verdict:
        file = tmp_path / 'compose.py'
        file.write_text(text, encoding='utf-8')
        verdict = judge_composition(file)
        assert list(tmp_path.iterdir()) == [file]
        return verdict

    return judge


def test_the_finished_template_is_right_also_where_its_nodes_start_slowly(
    judged: Callable[[str], Verdict],
) -> None:
    slow = '__import__("time").sleep(2.5) or Relay(), Key'
    right, sentence = judged(RIGHT.replace('Relay(), Key', slow))
    assert right
    assert sentence == (
        '4 nodes, /bag_recorder, /keyboard, /relay, /vehicle_simulator; each of /cmd_vel, /ecu, '
        '/z_vhcl has one publisher'
    )


@pytest.mark.slow
@pytest.mark.parametrize(
    ('old', 'new', 'sentence'),
    [
        ('Relay(), Key', 'Relay(), Relay(), Key', '/ecu has 2 publishers (relay, relay); expected'),
        (
            'Relay(), Key',
            'Key',
            '3 nodes, /bag_recorder, /keyboard, /vehicle_simulator; expected 4',
        ),
        ('Terminal())]', 'Terminal)]', 'compose.py, line 25: it has ended with exit code 1: '),
        ('executor.add_node(node)', 'pass', 'no executor has bag_recorder, vehicle_simulator,'),
        ('executor.spin()', 'pass', 'exit code 0: is main called, and does an executor spin?'),
        ('rclpy.init()', 'rclpy.init(', "compose.py, line 30: syntax error: '(' was never closed"),
    ],
)
def test_a_mistake_in_a_composition_is_named_in_a_sentence(
    judged: Callable[[str], Verdict], old: str, new: str, sentence: str
) -> None:
    assert old in RIGHT
    right, text = judged(RIGHT.replace(old, new))
    assert not right
    assert sentence in text


@pytest.mark.parametrize(
    'text',
    [
        'import os\nos.mkfifo("nodes.json")\n',
        'open("nodes.json", "w").write("[" * 5000)\n',
        'open("nodes.json", "w").write(\'[["a"], {"/ecu": 5}, []]\')\n',
    ],
    ids=['a pipe', 'brackets', 'another shape'],
)
def test_a_file_of_the_checks_own_name_is_named(
    judged: Callable[[str], Verdict], text: str
) -> None:
    assert judged(text) == (
        False,
        'it has written nodes.json, which barc check needs: write another',
    )


def test_a_script_that_ends_early_or_never_is_named(
    judged: Callable[[str], Verdict], monkeypatch: pytest.MonkeyPatch
) -> None:
    assert judged('raise SystemExit(4)\n') == (False, 'it has ended with exit code 4')
    monkeypatch.setattr(compose_check, '_DEADLINE', 0.5)
    verdict = judged('import re\nre.match("(a+)+$", "a" * 60 + "b")\n')
    assert verdict.sentence.startswith('it was ended after 0.5 s')


def test_an_unchanged_template_is_not_run_but_named(tmp_path: Path) -> None:
    (tmp_path / 'relay.py').write_text('def relay(x, z):\n    return [x, 0.3 * z]\n')
    (tmp_path / 'compose.py').write_text(TEMPLATE, encoding='utf-8')
    assert (
        printed('check', str(tmp_path), '--no-plot').splitlines()[-1]
        == 'compose.py: is not written yet (TODO)'
    )
