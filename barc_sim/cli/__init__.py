"""What every command and every process shares: the parser, exit codes, signals.

The commands themselves are in `commands`.
"""
