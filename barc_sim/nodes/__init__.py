"""The nodes; each converts messages, calls a pure function and publishes."""
