"""The lab of the hills: what is right in it, which mistakes are common, and how each is judged."""
