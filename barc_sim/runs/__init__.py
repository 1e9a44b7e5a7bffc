"""The runs: nodes composed in one process, and what the terminal shows of them.

This room only composes: laws, nodes and files are in the rooms before it.
"""
