"""`barc COMMAND`, the same as `python -m barc_sim COMMAND`: finds the command and runs it.

Only the chosen command's module is imported, so that `--help` is quick.
"""

from __future__ import annotations

import os
import sys

# `python -m` puts the working directory first, where anyone's `socket.py` would be imported.
if (
    __name__ == '__main__'
    and not __file__.startswith(sys.path[0])
    and os.path.isdir(sys.path[0])  # noqa: PTH112 (nothing is imported yet)
    and os.path.samefile(sys.path[0], os.curdir)  # noqa: PTH121
):
    del sys.path[0]

if __name__ == '__main__':
    # Before the other imports, so that Ctrl-C ends them silently.
    import barc_sim.run

    sys.exit(barc_sim.run.main())

import argparse
from importlib import import_module
from typing import TYPE_CHECKING

from barc_sim import __version__
from barc_sim.cli.parser import ROS_ARGS, Parser, call, check_arguments, did_you_mean
from barc_sim.cli.process import interruptible
from barc_sim.cli.python import ignore_working_directory
from barc_sim.commands import COMMANDS, GROUPS, SHARED
from barc_sim.interfaces.nodes import ALONE

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

_SHELLS = ('bash', 'zsh', 'fish')
_COMPLETION = 'complete commands and options: put eval "$(barc --completion bash)" in ~/.bashrc'


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line `argv` and return its exit code."""
    if '_ARGCOMPLETE' in os.environ:
        _complete()
    words = list(sys.argv[1:] if argv is None else argv)
    if not words:
        words = ['--help']

    name = words[0]
    if name in COMMANDS:
        return call(f'barc {name}', lambda: run(name, words[1:]))
    return call('barc', lambda: _print_about(words))


def run(name: str, words: Sequence[str]) -> int | None:
    """Run the command `name` with the arguments `words`, and return its exit code."""
    ignore_working_directory()
    check_arguments(words)
    _, run_command = functions(name)
    options = parse(name, words)
    with interruptible():
        return run_command(options)


def functions(
    name: str,
) -> tuple[Callable[[Parser], None], Callable[[argparse.Namespace], int | None]]:
    """Import the module of a command; return its `add_arguments` and its `run`.

    `commands/__init__.py` has the rules for their names: those of `acc` are `add_arguments_acc` and
    `run_acc` in `commands/drive.py`.
    """
    module = import_module(f'barc_sim.commands.{SHARED.get(name, name)}')
    suffix = f'_{name}' if name in SHARED else ''
    return getattr(module, f'add_arguments{suffix}'), getattr(module, f'run{suffix}')


def parse(name: str, words: Sequence[str]) -> argparse.Namespace:
    """Return the options of a command; `argv` in them is the whole command line.

    `ros_args` in them is `--ros-args` and what follows, if the command accepts these.
    """
    parser = Parser(prog=f'barc {name}')
    add_arguments, _ = functions(name)
    add_arguments(parser)

    end = len(words)
    if parser.get_default('ros_args') is not None and ROS_ARGS in words:
        end = words.index(ROS_ARGS)
        parser.set_defaults(ros_args=[*words[end:]])
    return parser.parse_args(words[:end], argparse.Namespace(argv=[name, *words]))


def _print_about(argv: Sequence[str]) -> None:
    """Print help, version or the shell's completion script; refuse an unknown command."""
    width = max(map(len, COMMANDS)) + 2
    groups = []
    for group, commands in GROUPS.items():
        lines = [f'  {name:{width}}{text}\n' for name, text in commands.items()]
        groups.append(f'{group}:\n{"".join(lines)}')
    parser = Parser(
        prog='barc',
        usage='barc COMMAND [OPTION...]',
        description='\n'.join([*groups, 'barc COMMAND --help lists the options of a command.']),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument('--version', action='version', version=f'barc {__version__}')
    parser.add_argument('--completion', choices=_SHELLS, metavar='SHELL', help=_COMPLETION)

    if not argv[0].startswith('-'):
        names = [*COMMANDS, *(f'node {name}' for name in ALONE)]
        parser.error(f'there is no command {argv[0]!r}{did_you_mean(argv[0], names)}')
    shell = parser.parse_args(argv).completion
    if shell:
        import argcomplete  # noqa: PLC0415

        print(argcomplete.shellcode(['barc'], shell=shell))  # type: ignore[attr-defined]  # noqa: T201
    else:
        parser.print_help()


def _complete() -> None:
    """Answer the shell's request for completions, and end the process."""
    import argcomplete  # noqa: PLC0415 (not for a run)

    parser = Parser(prog='barc')
    commands = parser.add_subparsers()
    command_words = os.environ['COMP_LINE'].split()[1:2]
    for name, text in COMMANDS.items():
        command = commands.add_parser(name, help=text)
        if name in command_words:
            add_arguments, _ = functions(name)
            add_arguments(command)
    argcomplete.autocomplete(parser)
