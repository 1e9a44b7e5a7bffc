"""Which mirrors are asked for."""

from __future__ import annotations

from argparse import Namespace

import pytest

from barc_sim.cli.parser import Parser
from barc_sim.nodes.mirrors.options import MIRRORS, add_mirror_options, wanted


def parse(*argv: str) -> Namespace:
    parser = Parser(prog='prog')
    add_mirror_options(parser)
    return parser.parse_args(argv)


@pytest.mark.parametrize(
    ('argv', 'expected'),
    [
        ([], set()),
        (['--mirrors', 'none'], set()),
        (['--mirrors', 'all'], set(MIRRORS)),
        (['--mirrors', 'odom,path'], {'odom', 'path'}),
        (['--foxglove'], set(MIRRORS)),
        (['--foxglove', '--mirrors', 'none'], set()),
        (['--foxglove', '9000', '--mirrors', 'accel'], {'accel'}),
    ],
)
def test_mirrors_are_those_that_are_named_or_all_for_foxglove(
    argv: list[str], expected: set[str]
) -> None:
    assert wanted(parse(*argv)) == expected


def test_program_without_these_options_wants_none() -> None:
    assert wanted(Namespace()) == set()


def test_port_is_where_the_app_looks_unless_another_is_named() -> None:
    assert [parse(*argv).foxglove for argv in ([], ['--foxglove'], ['--foxglove', '0'])] == [
        None,
        8765,
        0,
    ]


@pytest.mark.parametrize('names', ['', 'odom,', 'Odom', 'odom path', 'all,odom'])
def test_mirror_that_is_none_is_refused(names: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as exit_:
        parse(f'--mirrors={names}')
    assert exit_.value.code == 2
    assert f"{names!r} is neither 'all', 'none' nor some of odom,tf,path" in capsys.readouterr().err
