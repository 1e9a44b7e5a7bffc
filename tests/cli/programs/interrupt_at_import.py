"""Run a program with `info --help`, and interrupt it when a module is imported first."""

from __future__ import annotations

import os
import runpy
import signal
import sys

program, module = sys.argv[1:]


class InterruptingFinder:
    """Interrupts this process when somebody looks for the module."""

    def find_spec(self, name: str, path: object = None, target: object = None) -> None:  # noqa: ARG002
        """Find nothing."""
        if name == module:
            os.kill(os.getpid(), signal.SIGINT)


sys.meta_path.insert(0, InterruptingFinder())
sys.argv = ['barc', 'info', '--help']
runpy.run_module(program, run_name='__main__', alter_sys=True)
