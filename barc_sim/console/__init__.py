"""The terminal: keys that are read, lines that are shown."""
