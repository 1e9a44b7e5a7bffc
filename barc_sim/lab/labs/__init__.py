"""Each lab: what is right in it, which mistakes are common, and how both are judged."""
