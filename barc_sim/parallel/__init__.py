"""Work in pieces, on the cores of this machine or on those of many.

A command or a function splits its work into pieces, each a call of a function. Any executor of
`concurrent.futures` takes them. `pieces.py` hands the pieces out and takes the results as they are
ready; `processes.py` and `cluster.py` open the executors of a command's options, and
`interruptible.py` lets Ctrl-C end the waiting for them.
"""
