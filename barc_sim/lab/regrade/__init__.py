"""Whether a bag can have come from the code that is attached to it."""
