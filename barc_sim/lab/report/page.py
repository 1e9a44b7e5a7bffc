"""A report as one HTML file that needs no network; whatever others have written is escaped."""

from __future__ import annotations

from base64 import b64encode
from html import escape
from importlib import resources
from math import isnan
from string import Template
from typing import TYPE_CHECKING

import numpy as np

from barc_sim import __version__
from barc_sim.lab.report import code, figures
from barc_sim.simulation.metrics import RUN_UP, SETTLING_BAND

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from barc_sim.lab.report.facts import Facts

_DASH = '–'  # noqa: RUF001 (what tables have for nothing)
_TOLD = {
    'command': 'Command',
    'road': 'Road',
    'kp': 'Gain kp',
    'ki': 'Gain ki',
    'kd': 'Gain kd',
    'steps': 'Steps',
    'missed_deadlines': 'Missed deadlines',
    'slipped_periods': 'Clock slips',
    'barc_sim': 'barc_sim',
    'python': 'Python',
    'platform': 'Platform',
}


def page(facts: Facts) -> str:
    """Return the report."""
    template = resources.files('barc_sim.lab.report') / 'report.html'
    failure = facts.info.get('failure')
    return Template(template.read_text('utf-8')).substitute(
        name=escape(facts.name),
        colors=code.css(),
        note=f'<p class="note">The run was ended: {escape(failure)}</p>' if failure else '',
        facts=_pairs({_TOLD[key]: facts.info[key] for key in _TOLD if key in facts.info}),
        figures=_figures(facts),
        metrics=_metrics(facts),
        code=_code(facts.sources),
        graph=_graph(facts),
        parameters=escape(facts.info.get('parameters', '').strip() or 'not recorded'),
        hashes=_pairs(facts.hashes, kind='code'),
        version=__version__,
    )


def _pairs(pairs: Mapping[str, str], kind: str = 'span') -> str:
    return '\n'.join(
        f'<tr><th scope="row">{escape(name)}</th><td><{kind}>{escape(value)}</{kind}></td></tr>'
        for name, value in pairs.items()
    )


def _figures(facts: Facts) -> str:
    log = facts.log
    low, high = _span(log.speed)
    shown = [
        _figure(
            figures.speed(log),
            'Speed, grade and command',
            f'The speed over the position along the road, between {low} and {high} m/s; below it '
            "the road's grade and the commanded acceleration.",
        )
    ]
    if (terms := figures.terms(log)) is not None:
        alt = f'The terms {", ".join(facts.log.terms)} over the position along the road.'
        shown.append(_figure(terms, "The controller's terms", alt))
    if (path := figures.path(log)) is not None:
        shown.append(_figure(path, "The car's way", "The car's way from above, y over x."))
    return '\n'.join(shown)


def _span(values: np.ndarray[tuple[int], np.dtype[np.float64]]) -> tuple[str, str]:
    known = values[~np.isnan(values)]
    return (f'{known.min():.3g}', f'{known.max():.3g}') if known.size else (_DASH, _DASH)


def _figure(svg: str, caption: str, alt: str) -> str:
    data = b64encode(svg.encode()).decode()
    return (
        f'<figure><figcaption>{caption}</figcaption><div class="wide" tabindex="0">'
        f'<img alt="{escape(alt)}" src="data:image/svg+xml;base64,{data}"></div></figure>'
    )


def _metrics(facts: Facts) -> str:
    result = facts.summary
    if np.isnan(facts.log.reference).all():
        return '<p>Nobody gave a speed to hold: there is no error to measure.</p>'
    rows = [
        ('whole run', '', result.rms_error, result.max_error),
        (
            f'after the first {RUN_UP:g} m',
            '',
            result.rms_error_after_run_up,
            result.max_error_after_run_up,
        ),
    ]
    rows += [
        (
            f'{_number(part.start, ".1f")} to {_number(part.end, ".1f")} m',
            f'{_number(part.theta_deg, "+.0f")}°',
            part.rms_error,
            part.max_error,
        )
        for part in result.stretches[:_ROWS]
    ]
    body = '\n'.join(
        f'<tr><th scope="row">{where}</th><td>{grade}</td><td>{_number(rms, ".4f")}</td>'
        f'<td>{_number(greatest, ".4f")}</td></tr>'
        for where, grade, rms, greatest in rows
    )
    more = len(result.stretches) - _ROWS
    return (
        '<div class="wide" tabindex="0"><table class="figures"><thead><tr>'
        '<th scope="col">Where</th><th scope="col">Grade</th>'
        '<th scope="col">RMS error [m/s]</th><th scope="col">Greatest error [m/s]</th>'
        f'</tr></thead><tbody>\n{body}\n</tbody></table></div>\n'
        + (f'<p>… and {more} stretches more.</p>\n' if more > 0 else '')
        + f'<p>Overshoot {_number(result.overshoot, ".1%")}, settling time '
        f'(±{SETTLING_BAND:.0%}) {_number(result.settling_time, ".2f")} s.</p>'
    )


#: Stretches of road in the table.
_ROWS = 40


def _number(value: float, form: str) -> str:
    return _DASH if isnan(value) else format(value, form)


def _code(sources: Mapping[str, str]) -> str:
    if not sources:
        return "<p>The run was driven by barc_sim's own model and controller.</p>"
    return '\n'.join(_file(name, text) for name, text in sources.items())


def _file(name: str, text: str) -> str:
    return f'<h3>{escape(name)}</h3>\n<pre class="code" tabindex="0">{code.to_html(text)}</pre>'


def _graph(facts: Facts) -> str:
    if facts.graph is None:
        return '<p>The graph was not recorded.</p>'
    alt = _sentences(
        [f'{node} publishes {topic}' for node, topic in facts.graph.publications]
        + [f'{node} hears {topic}' for topic, node in facts.graph.subscriptions]
    )
    return _figure(figures.graph(facts.graph), 'Nodes and topics', alt)


def _sentences(parts: Iterable[str]) -> str:
    return '; '.join(parts) or 'No connections.'
