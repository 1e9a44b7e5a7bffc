"""A process for the code that strangers hand in."""
