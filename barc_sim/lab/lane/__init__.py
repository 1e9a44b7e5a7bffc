"""Lab 3: the errors beside a track, and a steering law that keeps the lane."""
