"""Bags: files of MCAP, read, written and made whole again."""
