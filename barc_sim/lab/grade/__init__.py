"""Grades submissions: `grade.py` one of them, `classroom.py` a class."""
