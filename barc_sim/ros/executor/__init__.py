"""The executor of every run."""
