"""The executor beside rclpy's own: answers per second, a timer's jitter, processor time.

Ping-pong: two nodes answer one another as fast as they can, once more with the recorder on.
Jitter: a 50 Hz timer publishes on seven topics, beside the recorder and a node whose callback
sleeps 100 ms in every 200 ms.
"""

from __future__ import annotations

from statistics import median
from typing import TYPE_CHECKING

from _compare import EXECUTORS, Found, at_least_one, interleaved, table

if TYPE_CHECKING:
    import argparse

    from matplotlib.figure import Figure

_CASES = ('ping-pong', 'ping-pong, recorded', 'jitter')


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    parser.add_argument(
        '--repeat', type=at_least_one, default=5, metavar='N', help='repetitions (5)'
    )
    parser.add_argument(
        '--seconds', type=at_least_one, default=5, metavar='S', help='of each measurement (5)'
    )
    parser.add_argument(
        '--case', choices=_CASES, action='append', help='measure only this; can be repeated'
    )


def measure(options: argparse.Namespace) -> Found:
    """Return the figures of each case and executor, a list of one per repetition."""
    cases = options.case or list(_CASES)
    return interleaved('_executor.py', cases, options.repeat, seconds=options.seconds)


def report(found: Found) -> str:
    """Return a table."""
    return table(found)


def plot(found: Found) -> Figure:
    """Draw each case's first figure: medians as dots, ranges as whiskers."""
    from matplotlib.figure import Figure  # noqa: PLC0415 (only where a picture is asked for)

    figure = Figure(figsize=(3.5 * len(found), 3.2), layout='constrained')
    for axes, (case, by_executor) in zip(
        figure.subplots(1, len(found), squeeze=False)[0], found.items(), strict=True
    ):
        key = next(iter(by_executor['ours'][0]))
        for place, (name, runs) in enumerate(by_executor.items()):
            values = [run[key] for run in runs]
            color = 'tab:blue' if name == 'ours' else 'dimgray'
            axes.vlines(place, min(values), max(values), color=color)
            axes.plot(place, median(values), 'o', color=color)
            label = f' {median(values):,.4g}'
            axes.annotate(
                label, (place, median(values)), xytext=(6, -3), textcoords='offset points'
            )
        names = [
            title.replace('Executor', '').replace('Thr', '\nThr') for title in EXECUTORS.values()
        ]
        axes.set_xticks(range(len(names)), names)
        axes.set(title=case, ylabel=key, yscale='log', xlim=(-0.4, len(names) - 0.2))
        axes.margins(y=0.15)
        axes.spines[['top', 'right']].set_visible(False)
    return figure
