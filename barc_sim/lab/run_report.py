"""Writes a run as one HTML page: its facts, read from a bag, and its figures."""

from __future__ import annotations

import io
import warnings
from contextlib import suppress
from dataclasses import dataclass
from math import isnan
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from pygments import highlight
from pygments.formatters import HtmlFormatter
from pygments.lexers import PythonLexer

from barc_sim.bags import reader
from barc_sim.bags.graph import NodeGraph
from barc_sim.figures.drawn_log import with_zero_for_unknown_errors
from barc_sim.figures.files import save
from barc_sim.figures.graph_figure import graph_figure
from barc_sim.figures.run_figures import drive_figure, is_by_hand, speed_figure, terms_figure
from barc_sim.figures.track_figure import track_figure
from barc_sim.lab.pages import data_url, render
from barc_sim.lab.user_code.code import attached
from barc_sim.simulation.log import TrackLog
from barc_sim.simulation.metrics import (
    RUN_UP,
    SETTLING_BAND,
    changes_of,
    lap_settings_of,
    laps_of,
)

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence
    from pathlib import Path

    from matplotlib.figure import Figure
    from numpy.typing import NDArray

    from barc_sim.simulation.log import Log
    from barc_sim.simulation.metrics import Lap, Laps

_DASH = '–'  # noqa: RUF001 (the usual sign for an empty cell)
_SETTINGS = {
    'command': 'Command',
    'road': 'Road',
    'track': 'Track',
    'lane': 'Steering law',
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
_MAX_STRETCHES = 40  #: in the table
_MAX_CHANGES = 40  #: of parameters
_MAX_SHOWN = 100_000  #: characters of code
_VISIBLE = 0.01  #: [m] A car that leaves the road's axis by more has steered.
_FORMATTER = HtmlFormatter(nowrap=True)
_MAX_VALUE = 1e9  #: Larger values come from a damaged bag.


@dataclass(frozen=True)
class ReportFacts:
    """The facts of a run for a report."""

    name: str
    log: Log
    info: Mapping[str, str]
    laps: Laps
    numbers: Sequence[int]  #: for each state, the number of its lap
    graph: NodeGraph | None
    sources: Mapping[str, str]  #: user code, by file name

    @property
    def holds_speed(self) -> bool:
        """Whether the run has a reference speed to hold, and no track."""
        return not (isinstance(self.log, TrackLog) or np.isnan(self.log.reference).all())

    @property
    def shown_lap(self) -> Lap:
        """The lap whose figures are shown: the best one, or the only one."""
        return self.laps.best or self.laps.current

    @property
    def shown_states(self) -> Log:
        """The states of the shown lap."""
        of_lap = np.array(self.numbers) == self.shown_lap.number
        return self.log.map(lambda column: column[of_lap])

    @property
    def lap_gains(self) -> list[str]:
        """The gains of each lap, in their order."""
        settings = lap_settings_of(self.log, self.numbers)
        return [settings.text(lap.number) for lap in self.laps]

    @property
    def settings(self) -> list[tuple[str, str]]:
        """The settings of the run by name; a gain that was changed has all its values."""
        changes = changes_of(self.log)
        settings = []
        for key, name in _SETTINGS.items():
            if key in changes:
                settings.append((name, changes.pop(key).removeprefix(f'{key} ')))
            elif key in self.info:
                settings.append((name, self.info[key]))
        for name, text in changes.items():
            settings.append((name, text.removeprefix(f'{name} ')))
        return settings

    @property
    def changes(self) -> list[tuple[float, str, float]]:
        """Each change of a parameter during the run: time [s], parameter and new value."""
        rows = []
        for name, values in self.log.parameters.items():
            is_change = (values[1:] != values[:-1]) & ~np.isnan(values[1:])
            for k in np.flatnonzero(is_change) + 1:
                row = float(self.log.t[k]), name, float(values[k])
                rows.append(row)
        return sorted(rows)


def read(path: Path, namespace: str | None = None) -> ReportFacts:
    """Read the bag at `path`; a UserError if there is no bag, or it has no car, or several."""
    bag = reader.load(path)
    log = _drawable(bag.log(namespace))
    laps, numbers = laps_of(log)

    graph = None
    with suppress(KeyError, ValueError):  # a run has no graph, or a damaged one
        graph = NodeGraph.from_json(bag.info['graph'])

    directory = path if path.is_dir() else path.parent
    sources = attached(bag.attachments)
    return ReportFacts(
        name=directory.resolve().name,
        log=log,
        info=bag.info,
        laps=laps,
        numbers=numbers,
        graph=graph,
        sources={name: data.decode(errors='replace') for name, data in sources.items()},
    )


def _drawable(log: Log) -> Log:
    """Return the log with NaN for values that cannot be drawn."""

    def drawable(column: NDArray[Any]) -> NDArray[Any]:
        if column.dtype == np.bool_:
            return column
        return np.where(np.abs(column) < _MAX_VALUE, column, np.nan)

    return with_zero_for_unknown_errors(log.map(drawable))


class _Figure(NamedTuple):
    """A figure on the page."""

    url: str  #: contains the image
    caption: str
    alt: str


def page(facts: ReportFacts) -> str:
    """Return the report as HTML."""
    with warnings.catch_warnings():
        warnings.simplefilter('ignore')  # characters that the font lacks
        figures = list(_figures(facts))
        graph = _graph(facts)

    lap_gains = facts.lap_gains
    return render(
        'report',
        facts=facts,
        failure=facts.info.get('failure'),
        settings=facts.settings,
        lap_gains=lap_gains,
        has_gains=any(lap_gains),
        figures=figures,
        held=facts.holds_speed,
        number=_number,
        run_up=RUN_UP,
        most_stretches=_MAX_STRETCHES,
        changes=facts.changes,
        most_changes=_MAX_CHANGES,
        settling_band=f'{SETTLING_BAND:.0%}',
        sources=[*_shown(facts.sources)],
        code_style=_FORMATTER.get_style_defs('.code'),  # type: ignore[no-untyped-call]
        graph=graph,
    )


def _shown(sources: Mapping[str, str]) -> Iterator[tuple[str, str]]:
    """Yield the name and the HTML of each file; long files are cut."""
    left = _MAX_SHOWN
    for name, text in sources.items():
        shown = text[:left]
        if len(text) > left:
            shown += f'\n# ... cut: {len(text)} characters in all\n'
        yield name, _highlighted(shown)
        left = max(left - len(text), 0)


def _highlighted(text: str) -> str:
    """Return Python code as HTML, escaped and in colours, with an element for each line."""
    colored = highlight(text, PythonLexer(stripnl=False, ensurenl=False), _FORMATTER)
    lines = colored.removesuffix('\n').split('\n')
    return ''.join(f'<span class="line">{line}\n</span>' for line in lines)


def _figures(facts: ReportFacts) -> Iterator[_Figure]:
    log = facts.log
    if isinstance(log, TrackLog):
        yield _drawn(
            track_figure(log),
            'Laps of the track',
            'The path on the track from above, and a table of laps; beside it the errors e_y and '
            'e_psi, speed and steering over the position in the lap.',
        )
        return

    is_steered = np.isnan(log.reference).all() and np.any(np.abs(log.across) > _VISIBLE)
    if is_steered or is_by_hand(log):
        if np.nan_to_num(log.servo).any():
            caption = 'Path, heading, speed and steering'
            alt = "The car's path from above; below it heading, speed and steering angle over time."
        else:
            caption = 'Speed and command'
            alt = 'The speed over time; below it the commanded acceleration.'
        yield _drawn(drive_figure(log), caption, alt)
        return

    yield _drawn(
        speed_figure(log),
        'Speed, grade and command',
        "The speed over the position along the road; below it the road's grade and the commanded "
        'acceleration; of several laps, a table of errors and gains.',
    )
    terms = terms_figure(facts.shown_states)
    if terms is not None:
        of_lap = f' in lap {facts.shown_lap.number + 1}' if facts.laps.finished else ''
        alt = f'The terms {", ".join(log.terms)} over the position along the road{of_lap}.'
        yield _drawn(terms, f"The controller's terms{of_lap}", alt)


def _drawn(figure: Figure, caption: str, alt: str) -> _Figure:
    text = io.StringIO()
    same_ids = {'svg.hashsalt': 'barc_sim'}  # the same figures each time
    save(figure, text, same_ids, format='svg', metadata={'Date': None})
    return _Figure(data_url('image/svg+xml', text.getvalue().encode()), caption, alt)


def _number(value: float, form: str) -> str:
    return _DASH if isnan(value) else format(value, form)


def _graph(facts: ReportFacts) -> _Figure | None:
    if facts.graph is None:
        return None
    parts = [f'{node} publishes {topic}' for node, topic in facts.graph.publications]
    parts += [f'{node} subscribes to {topic}' for topic, node in facts.graph.subscriptions]
    alt = '; '.join(parts) or 'No connections.'
    return _drawn(graph_figure(facts.graph), 'Nodes and topics', alt)
