"""The node `view`, which feeds the live page."""
