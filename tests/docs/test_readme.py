"""README fits a screen of patience, names no file that is not there, and leads to the answers."""

from __future__ import annotations

import re
from pathlib import Path

ROOT = Path(__file__).parents[2]
README = (ROOT / 'README.md').read_text(encoding='utf-8')
_CLICKS = 2


def links(page: Path) -> set[Path]:
    """Return the pages that a page links to."""
    text = page.read_text(encoding='utf-8')
    targets = {(page.parent / path).resolve() for path in re.findall(r'\]\(([\w/.-]+\.md)', text)}
    return {path for path in targets if path.is_file()}


def reached(page: Path) -> dict[Path, int]:
    """Return the clicks from `page` to each page within two."""
    clicks = {page: 0}
    for count in range(1, _CLICKS + 1):
        nearer = [each for each, number in clicks.items() if number == count - 1]
        for other in {other for each in nearer for other in links(each)}:
            clicks.setdefault(other, count)
    return clicks


def test_the_readme_is_short() -> None:
    assert len(README.splitlines()) <= 120


def test_each_picture_and_file_that_the_readme_names_exists() -> None:
    for path in re.findall(r'\]\(([\w/.-]+)', README):
        assert (ROOT / path).exists(), path


def test_every_page_of_the_documentation_is_reached_from_readme_within_three_clicks() -> None:
    near = reached(ROOT / 'README.md')
    reachable = {*near, *(other for each in near for other in links(each))}
    pages = {page for page in (ROOT / 'docs').rglob('*.md') if '_build' not in page.parts}
    assert {*pages} <= reachable
