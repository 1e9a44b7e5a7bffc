"""The report of a run: what is printed around it, and its exit code."""

from __future__ import annotations

import shlex
from typing import TYPE_CHECKING

from barc_sim.cli.parser import barc_path, report

if TYPE_CHECKING:
    from argparse import Namespace
    from collections.abc import Callable

    from barc_sim.nodes.recorder import BagRecorder
    from barc_sim.runs.composition import Run


def print_line(options: Namespace, text: str) -> None:
    """Print a line about the run, unless the options have `--quiet`."""
    if not options.quiet:
        print(text, flush=True)  # noqa: T201


def print_report(run: Run, print_result: Callable[[], None]) -> int:
    """Print what a run has brought, and return its exit code.

    Parameters
    ----------
    run
        The run, which has ended.
    print_result
        Prints the results; not called if the options have `--quiet`.

    Returns
    -------
    int
        1 if user code or the recorder failed, or an error ended the run; otherwise 0.
    """
    recorder = run.bag.recorder if run.bag else None
    if not run.options.quiet:
        print_result()
        if recorder:
            _print_commands(recorder)
    elif recorder:
        print(recorder.path)  # noqa: T201

    if run.failure:
        report(f'barc {run.options.mode}', run.failure)
    has_failed = run.failure or (recorder and recorder.failure)
    return 1 if has_failed else 0


def _print_commands(recorder: BagRecorder) -> None:
    """Print the bag's path, and the commands that read it."""
    barc = barc_path()
    path = shlex.quote(str(recorder.path))
    print(recorder.summary)  # noqa: T201
    print(f'bag     {path}')  # noqa: T201
    print(f'plot    {barc} plot {path}')  # noqa: T201
    print(f'replay  {barc} replay {path}')  # noqa: T201


def late(run: Run) -> str:
    """Return the counts of missed deadlines and clock slips, to print."""
    return f'missed deadlines {run.missed}, clock slips {run.slipped}'
