"""How often a relay commands, and how long it believes a Twist."""

RATE = 20.0  #: [Hz] commands per second; the lab's template has dt = 0.05
STALE_AFTER = 0.5  #: [s] An older Twist is ignored.
