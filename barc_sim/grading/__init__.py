"""Grading: submissions run confined and answer calls; scores, rubric and reports stay outside."""
