"""Each lab: its right results, its common mistakes, and how both are judged."""
