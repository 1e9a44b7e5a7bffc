"""One thin module for each command of `barc`: its options, and the call that does the work."""
