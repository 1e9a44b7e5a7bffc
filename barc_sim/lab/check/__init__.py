"""How the user code of any lab is judged: its calls, laws with their mistakes, and findings."""
