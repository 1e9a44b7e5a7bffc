"""The pages are easy to read: short sentences, and no word of which the house has a plainer one."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

DOCS = Path(__file__).parents[2] / 'docs'
PLAIN = sorted([*DOCS.glob('tutorials/*.md'), *DOCS.glob('how-to/*.md')])
PAGES = sorted(path for path in DOCS.rglob('*.md') if '_build' not in path.parts)
AVERAGE = 15.0
#: Words for which there is a plainer one, and machines that hear or wish.
AVOIDED = re.compile(
    r'\b(go on|lets? go of|somebody|manoeuvres?|whoever|meanwhile|thereof|bears?'
    r'|(node|simulator|controller|run|recorder|page|command) (hears|says|tells|wishes|knows))\b',
    re.IGNORECASE,
)


def sentences(text: str) -> list[list[str]]:
    """Return the words of each sentence of a page, without code, tables and formulas."""
    text = re.sub(r'^( *)```.*?^\1```$', '\n\n', text, flags=re.MULTILINE | re.DOTALL)
    text = re.sub(r'\$\$.*?\$\$|<!--.*?-->', '', text, flags=re.DOTALL)
    text = re.sub(r'\$[^$\n]+\$', 'x', text)
    text = re.sub(r'`[^`\n]+`', 'x', text)
    text = re.sub(r'\]\([^)]*\)', ']', text)
    lines = [line for line in text.splitlines() if not re.match(r'\s*([|#:(+]|\{)', line)]
    text = re.sub(r'^\s*(?:[-*]|\d+\.) ', '\n', '\n'.join(lines), flags=re.MULTILINE)
    texts = re.split(r'(?<=[.!?:])["*)]*\s+|\n\s*\n', text)
    words = [re.findall(r"[\w'+-]+", each) for each in texts]
    return [each for each in words if len(each) > 1]


@pytest.mark.parametrize('page', PLAIN, ids=lambda page: page.stem)
def test_the_sentences_of_a_page_are_short(page: Path) -> None:
    texts = sentences(page.read_text(encoding='utf-8'))
    average = sum(map(len, texts)) / max(len(texts), 1)
    assert average <= AVERAGE, f'{average:.1f} words'


@pytest.mark.parametrize('page', PAGES, ids=lambda page: page.stem)
def test_the_words_of_a_page_are_plain(page: Path) -> None:
    assert not AVOIDED.findall(page.read_text(encoding='utf-8'))
