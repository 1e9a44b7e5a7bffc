"""The runs: nodes composed in one process, and what the terminal shows of them.

This package only composes: laws, nodes and files are in the packages that it imports.
"""
