"""The keyboard of a terminal: its keys, and the input of a driver who holds them."""
