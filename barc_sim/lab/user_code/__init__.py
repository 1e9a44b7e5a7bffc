"""Loads and calls a user's own code."""
