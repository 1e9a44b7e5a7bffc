"""Judges whether a bag could have come from the code that is attached to it."""
