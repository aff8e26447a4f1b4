"""Which set of effects is the answer."""
