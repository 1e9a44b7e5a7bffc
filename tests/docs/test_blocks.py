"""Every code block of the documentation is run, or marked as not to be run, with the reason.

The blocks of a page run in order, in a folder of the page's own:

- `python`: statements; with `>>>`, what they print is compared, as doctest does.
- `bash`: commands, each of which must succeed.
- `console`: commands behind `$ `, and what they print; `...` stands for any text.
- any other language behind `<!-- file: NAME -->`: written to the file NAME first.
- one behind `<!-- run as: COMMAND -->`: COMMAND runs in place of its first, whose output differs on
  a busy machine.
- any block behind `<!-- not run: REASON -->`, and `text`: not run.
- `<!-- finished: FOLDER -->` before a block: a right model and controller are in FOLDER from here;
  `<!-- finished: FOLDER/compose.py -->`: so is that file.
"""

from __future__ import annotations

import doctest
import os
import re
import subprocess
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import pytest
from pages import PAGES, ROOT

if TYPE_CHECKING:
    from collections.abc import Iterator

#: Right answers to the lab's tasks.
RIGHT = {
    'bike_model.py': Path(__file__).parent / 'right' / 'bike_model.py',
    'controller.py': Path(__file__).parent / 'right' / 'controller.py',
    'compose.py': Path(__file__).parent / 'right' / 'compose.py',
}
_BLOCK = re.compile(
    r'(?:^<!-- (?P<mark>not run|file|run as): (?P<note>.+?) -->\n+)?'
    r'^(?P<indent> *)```(?P<language>[^`\n]*)\n(?P<text>.*?)^(?P=indent)```$',
    re.MULTILINE | re.DOTALL,
)
_SHOWN = ('text', 'none', '')
_CHECK = doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE
_CHANGING = re.compile(r'\d{4}-\d\d-\d\d_\d\d-\d\d-\d\d(_\d+)?')


class Block(NamedTuple):
    """A fenced block of a page."""

    language: str
    text: str
    mark: str  #: `not run`, `file` or none
    note: str
    line: int
    finished: tuple[str, ...]  #: folders, or files, to put right answers into


def blocks(page: Path) -> list[Block]:
    """Return the blocks of a page."""
    text = page.read_text(encoding='utf-8')
    return [
        Block(
            match['language'],
            re.sub(rf'^{match["indent"]}', '', match['text'], flags=re.MULTILINE),
            match['mark'] or '',
            match['note'] or '',
            text[: match.start('language')].count('\n') + 1,
            _finished_before(text[: match.start()]),
        )
        for match in _BLOCK.finditer(text)
    ]


def _finished_before(text: str) -> tuple[str, ...]:
    """Return the folders named right before a block."""
    behind = text.rpartition('\n\n')[2]
    return (*re.findall(r'^<!-- finished: (.+?) -->$', behind, re.MULTILINE),)


def is_run(block: Block) -> bool:
    if block.mark:
        return block.mark != 'not run'
    return block.language not in _SHOWN and not block.language.startswith('{')  # a directive


def name(page: Path) -> str:
    return str(page.relative_to(ROOT)).removeprefix('docs/')


@pytest.mark.parametrize('page', PAGES, ids=name)
def test_a_block_that_is_not_run_has_a_reason_and_others_a_runner(page: Path) -> None:
    for block in blocks(page):
        if is_run(block) and block.mark != 'file':
            assert block.language in {'python', 'bash', 'console'}, (name(page), block.line)
        if block.mark == 'not run':
            assert len(block.note.split()) > 1, (name(page), block.line)


RUN = [page for page in PAGES if any(map(is_run, blocks(page)))]


@pytest.mark.slow
@pytest.mark.timeout(400)
@pytest.mark.parametrize('page', RUN, ids=name)
def test_the_blocks_of_a_page_run(
    page: Path, tmp_path: Path, ros_domain: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    for package in filter(page.read_text(encoding='utf-8').count, ('gymnasium', 'daqp')):
        pytest.importorskip(package, reason='needs an extra')
    assert ros_domain

    monkeypatch.setenv('PATH', f'{Path(sys.executable).parent}{os.pathsep}{os.environ["PATH"]}')
    monkeypatch.setenv('MPLBACKEND', 'agg')
    monkeypatch.setenv('COLUMNS', '100')
    (tmp_path / 'scripts').symlink_to(ROOT / 'scripts')
    names: dict[str, Any] = {}
    monkeypatch.chdir(tmp_path)

    for block in filter(is_run, blocks(page)):
        where = f'{name(page)}:{block.line}'
        for finished in map(Path, block.finished):
            folder, files = finished, ('bike_model.py', 'controller.py')
            if finished.suffix:
                folder, files = finished.parent, (finished.name,)
            folder.mkdir(parents=True, exist_ok=True)
            for each in files:
                (folder / each).write_text(RIGHT[each].read_text(encoding='utf-8'))

        if block.mark == 'file':
            Path(block.note).parent.mkdir(parents=True, exist_ok=True)
            Path(block.note).write_text(block.text, encoding='utf-8')
        elif block.language == 'python':
            _run_python(block, names, where)
        elif block.language == 'bash':
            _run(block.text, where)
        else:
            for i, (typed, expected) in enumerate(_commands(block.text)):
                command = block.note if block.mark == 'run as' and i == 0 else typed
                _compare(expected, _run(command, where), where)


def _run_python(block: Block, names: dict[str, Any], where: str) -> None:
    if '>>> ' not in block.text:
        exec(compile(block.text, where, 'exec'), names)  # noqa: S102 (our own pages)
        return
    test = doctest.DocTestParser().get_doctest(block.text, names, where, where, block.line)
    output: list[str] = []
    runner = doctest.DocTestRunner(optionflags=_CHECK | doctest.IGNORE_EXCEPTION_DETAIL)
    runner.run(test, out=output.append, clear_globs=False)
    names |= test.globs
    assert not output, ''.join(output)


def _commands(text: str) -> Iterator[tuple[str, str]]:
    """Yield each command of a console block, with the output shown."""
    for part in re.split(r'^\$ ', text, flags=re.MULTILINE)[1:]:
        lines = part.split('\n')
        count = 1
        while lines[count - 1].endswith('\\'):
            count += 1
        yield '\n'.join(lines[:count]), '\n'.join(lines[count:])


def _run(command: str, where: str) -> str:
    process = subprocess.run(
        ['bash', '-euo', 'pipefail', '-c', command],  # noqa: S607
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        timeout=300,
        check=False,
    )
    shown_failure = 'exit 1' in command
    assert process.returncode == 0 or shown_failure, f'{where}: {command}\n{process.stdout}'
    return process.stdout


def _compare(expected: str, printed: str, where: str) -> None:
    expected_text, got = (_CHANGING.sub('DATE_TIME', text) for text in (expected, printed))
    if expected_text.strip():
        same = doctest.OutputChecker().check_output(
            expected_text.strip() + '\n', got.strip() + '\n', _CHECK
        )
        assert same, f'{where}: the page shows\n{expected}\nand the command prints\n{printed}'
