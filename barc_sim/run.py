"""The start of `barc`, also as `python -m barc_sim.run COMMAND`: sets the signals of the process.

`__main__` then finds the command, whose module is in `commands/`; those that drive compose their
nodes with `runs/`.

It imports little: until a command begins there is nothing to end in order, so Ctrl-C ends the
process at once, without Python's traceback.
"""

from __future__ import annotations

import signal
import sys
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Sequence

__all__ = ['main']


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line `argv` and return its exit code."""
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, signal.SIG_DFL)
    # `scripts/run` and an installed `barc` block them from before Python's own start.
    if hasattr(signal, 'pthread_sigmask'):
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT, signal.SIGTERM, signal.SIGHUP})

    import barc_sim.__main__  # noqa: PLC0415

    return barc_sim.__main__.main(argv)


if __name__ == '__main__':
    sys.exit(main())
