"""A grade as one HTML file that needs no network; whatever others have written is escaped."""

from __future__ import annotations

from base64 import b64encode
from html import escape
from string import Template
from typing import TYPE_CHECKING

from barc_sim import __version__
from barc_sim.lab.grade.labels import label

if TYPE_CHECKING:
    from collections.abc import Iterable

    from barc_sim.lab.grade.grade import Grade, Item

_PAGE = Template("""\
<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta http-equiv="Content-Security-Policy"
  content="default-src 'none'; img-src data:; style-src 'unsafe-inline'">
<title>$name: $score</title>
<style>
  :root { color: #222; background: #fff; font: 16px/1.5 system-ui, sans-serif; }
  body { max-width: 64rem; margin: 2rem auto; padding: 0 1rem; }
  header { display: flex; flex-wrap: wrap; justify-content: space-between; column-gap: 2rem; }
  h1, .score { font-size: 2rem; margin: 0; overflow-wrap: anywhere; }
  .score { font-weight: bold; }
  h2 { font-size: 1.2rem; margin: 2rem 0 .5rem; }
  .muted, footer { color: #6b6b6b; }
  .note { color: #a84300; }
  table { border-collapse: collapse; width: 100%; }
  th, td { text-align: left; vertical-align: top; padding: .5rem .75rem .5rem 0; }
  tr { border-bottom: 1px solid #e4e4e4; }
  th { font-weight: 600; white-space: nowrap; }
  td.points { text-align: right; white-space: nowrap; font-variant-numeric: tabular-nums; }
  td.message { overflow-wrap: anywhere; }
  meter { width: 6rem; height: 1rem; vertical-align: middle; }
  img { width: 100%; border: 1px solid #e4e4e4; }
  pre { background: #f5f5f5; padding: 1rem; max-height: 30rem; overflow: auto;
    white-space: pre-wrap; overflow-wrap: anywhere; }
  footer { margin-top: 3rem; font-size: .85rem; overflow-wrap: anywhere; }
  @media print { pre { max-height: none; } tr, img { break-inside: avoid; } }
</style>
</head>
<body>
<header><h1>$name</h1><p class="score">$score</p></header>
<p class="muted">$title</p>
$notes
<h2>Criteria</h2>
<table>
<thead><tr><th>Criterion</th><th></th><th>Points</th><th>Found</th></tr></thead>
<tbody>
$rows
</tbody>
</table>
$figures
$printed
<footer>barc_sim $version, seed $seed<br>$hashes</footer>
</body>
</html>
""")


def page(grade: Grade, figures: bytes) -> str:
    """Return the report; `figures` is a PNG, or empty."""
    return _PAGE.substitute(
        name=escape(grade.name),
        score=f'{grade.score:g} / {grade.max_score:g}',
        title=escape(grade.title),
        notes='\n'.join(f'<p class="note">{escape(note)}</p>' for note in grade.notes),
        rows=_rows(grade.items),
        figures=_figures(figures),
        printed=_printed(grade.printed),
        version=__version__,
        seed=grade.seed,
        hashes='<br>'.join(f'{escape(name)}: SHA-256 {digest}' for name, digest in grade.hashes),
    )


def _rows(items: Iterable[Item]) -> str:
    return '\n'.join(
        f'<tr><th scope="row">{escape(label(item.criterion))}</th>'
        f'<td><meter min="0" max="{item.max_points:g}" value="{item.points:g}"></meter></td>'
        f'<td class="points">{item.points:g} / {item.max_points:g}</td>'
        f'<td class="message">{escape(item.message)}</td></tr>'
        for item in items
    )


def _figures(png: bytes) -> str:
    if not png:
        return ''
    data = b64encode(png).decode()
    return (
        '<h2>Runs</h2>\n<img alt="The submission\'s runs beside what is expected" '
        f'src="data:image/png;base64,{data}">'
    )


def _printed(text: str) -> str:
    return f'<h2>What the code printed</h2>\n<pre>{escape(text)}</pre>' if text else ''
