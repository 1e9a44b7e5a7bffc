"""What every command and every process shares: the parser, exit codes, signals, a Dask cluster.

The commands themselves are in `commands`.
"""
