"""Lab 5: a drive that shows what a car is, and an estimate from it."""
