"""Figures, animations and what is drawn on them."""
