"""Processes for what strangers hand in: their code, and the archives that it comes in."""
