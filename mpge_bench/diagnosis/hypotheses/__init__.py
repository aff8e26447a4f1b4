"""What might be missing: effects of the catalogue, nameless curves, and what simulators may do differently."""
