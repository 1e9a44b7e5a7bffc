"""The nodes. A node converts, calls and publishes; it imports no other node."""
