"""The search for gains: thousands of closed loops at once, what each costs, the best of all."""
