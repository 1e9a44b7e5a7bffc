"""Grades submissions in confined processes."""
