"""Each command line of `barc` that a page, workflow or container file names exists."""

from __future__ import annotations

import re
from functools import cache
from typing import TYPE_CHECKING

import pytest
from pages import PAGES, ROOT

from barc_sim.__main__ import functions
from barc_sim.cli.parser import ROS_ARGS, Parser
from barc_sim.commands import COMMANDS
from barc_sim.interfaces.nodes import ALONE

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

FILES = [
    *(ROOT / '.github').rglob('*.yml'),
    *(ROOT / '.devcontainer').glob('*.json'),
    ROOT / 'Dockerfile',
    ROOT / 'pixi.toml',
]
#: In a page, what is typed is in a block or between backticks.
_CODE = re.compile(r'^ *```.*?^ *```|`[^`\n]+`', re.MULTILINE | re.DOTALL)
#: A command line ends with the line, or where a shell ends a command.
_PROGRAM = r'(?:barc|python3? -m barc_sim(?:\.run)?|scripts/run)'
_LINE = re.compile(rf'(?<![\w.{{$-]){_PROGRAM}\b[\'", ]+(?P<words>[^\n`|;&)<>]+)')


def command_lines(path: Path) -> Iterator[list[str]]:
    """Yield the words behind each `barc` in a file."""
    text = path.read_text(encoding='utf-8').replace('\\\n', ' ')
    if path.suffix == '.md':
        text = '\n'.join(_CODE.findall(text))
    for line in _LINE.finditer(text):
        yield re.sub(r'[\[\]\'",]', ' ', line['words']).split()


@cache
def options_of(command: str) -> frozenset[str]:
    """Return the names of all options that a command's parser has."""
    parser = Parser(prog='barc')
    add_arguments, _ = functions(command)
    add_arguments(parser)
    return frozenset(parser._option_string_actions)  # noqa: SLF001 (argparse has no public list)


def unknown_words(words: list[str]) -> list[str]:
    """Return the command, node or options among `words` that `barc` does not have."""
    command, *rest = words
    if not re.fullmatch('[a-z]+', command):
        return []  # an option of `barc`, or a placeholder as in `barc COMMAND`
    if command not in COMMANDS:
        return [command]
    if command == 'node' and rest and rest[0].islower():
        return [rest[0]] if rest[0] not in ALONE else []
    if ROS_ARGS in rest:
        rest = rest[: rest.index(ROS_ARGS)]
    options = {word.partition('=')[0] for word in rest if re.match('--[a-z]', word)}
    return sorted(options - options_of(command))


@pytest.mark.parametrize('path', [*PAGES, *FILES], ids=lambda path: str(path.relative_to(ROOT)))
def test_each_command_line_exists(path: Path) -> None:
    unknown = {' '.join(words): unknown_words(words) for words in command_lines(path)}
    assert not {line: words for line, words in unknown.items() if words}


def test_a_removed_command_or_option_is_found_in_the_pages() -> None:
    assert unknown_words(['validate', '--json']) == ['validate']
    assert unknown_words(['acc', '--speed', '6', '--sped=6']) == ['--sped']
    assert unknown_words(['node', 'controler']) == ['controler']
    assert not unknown_words(['grade', '--out', '/out'])


def test_command_lines_are_found_in_every_way_to_write_them(tmp_path: Path) -> None:
    page = tmp_path / 'page.md'
    page.write_text(
        'barc is fine. `barc plot A`\n```bash\n$ barc acc \\\n  --speed 6 | head\n```\n'
    )
    assert [*command_lines(page)] == [['plot', 'A'], ['acc', '--speed', '6']]

    container = tmp_path / 'Dockerfile'
    container.write_text(
        'ENTRYPOINT ["barc", "grade", "--out", "/out"]\nRUN /a/bin/barc new lab\n',
        encoding='utf-8',
    )
    assert [*command_lines(container)] == [['grade', '--out', '/out'], ['new', 'lab']]
