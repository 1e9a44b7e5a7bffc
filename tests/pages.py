"""The pages of the documentation."""

from pathlib import Path

ROOT = Path(__file__).parents[1]
PAGES = sorted(
    path
    for path in (ROOT / 'README.md', ROOT / 'CONTRIBUTING.md', *(ROOT / 'docs').rglob('*.md'))
    if not {'_build', '_figures'} & {*path.parts} and path.is_file()
)
