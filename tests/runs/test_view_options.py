"""The options of the live page and of the mirrors."""

from __future__ import annotations

from argparse import Namespace

import pytest

from barc_sim.cli.parser import Parser
from barc_sim.nodes import MIRRORS
from barc_sim.runs.options import (
    add_mirror_options,
    add_view_options,
    wanted_mirrors,
    wants_page,
)


def parse(*argv: str, on: bool = True) -> Namespace:
    parser = Parser(prog='prog')
    add_view_options(parser, on=on)
    add_mirror_options(parser)
    return parser.parse_args(argv)


@pytest.mark.parametrize(
    ('argv', 'on', 'expected'),
    [
        ([], True, True),
        ([], False, False),
        (['--view', 'auto'], True, True),
        (['--view', 'web'], False, True),
        (['--view', 'none'], True, False),
    ],
)
def test_auto_depends_on_the_mode(argv: list[str], on: bool, expected: bool) -> None:
    assert wants_page(parse(*argv, on=on)) is expected


@pytest.mark.parametrize(
    ('argv', 'expected'),
    [
        ([], set()),
        (['--mirrors', 'none'], set()),
        (['--mirrors', 'all'], set(MIRRORS)),
        (['--mirrors', 'odom,path'], {'odom', 'path'}),
        (['--foxglove'], set(MIRRORS)),
        (['--foxglove', '--mirrors', 'none'], set()),
        (['--foxglove', '9000', '--mirrors', 'odom'], {'odom'}),
    ],
)
def test_mirrors_are_those_named_or_all_for_foxglove(argv: list[str], expected: set[str]) -> None:
    assert wanted_mirrors(parse(*argv)) == expected


def test_program_without_these_options_shows_nothing() -> None:
    assert not wants_page(Namespace())
    assert not wanted_mirrors(Namespace())


@pytest.mark.parametrize(
    ('argv', 'expected'),
    [
        ([], ('127.0.0.1', 0, None)),
        (['--view-host', '::1', '--view-port', '8080', '--foxglove'], ('::1', 8080, 8765)),
        (['--foxglove', '0'], ('127.0.0.1', 0, 0)),
    ],
)
def test_addresses_are_of_this_machine_unless_named(
    argv: list[str], expected: tuple[str, int, int | None]
) -> None:
    options = parse(*argv)
    assert (options.view_host, options.view_port, options.foxglove) == expected


@pytest.mark.parametrize(
    ('argument', 'reason'),
    [
        *(
            (f'--view-port={port}', f'{port} is not a whole number from 0 to 65535')
            for port in ('-1', '65536', '80.0', '')
        ),
        *(
            (f'--mirrors={names}', f"{names!r} is neither 'all', 'none' nor some of odom,tf,path")
            for names in ('', 'odom,', 'Odom', 'odom path', 'all,odom')
        ),
    ],
)
def test_wrong_value_is_named(
    argument: str, reason: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as exit_:
        parse(argument)
    assert exit_.value.code == 2
    assert reason in capsys.readouterr().err
