"""What every command and every process shares: the parser, exit codes, signals, a Dask cluster.

No command of its own: those are in `commands`.
"""
