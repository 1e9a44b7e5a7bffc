"""A run: its nodes composed in one process, and what the terminal shows of it.

It composes; laws, nodes and files live in the rooms below.
"""
