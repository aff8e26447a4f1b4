"""What to record next: motions within limits, and which of them tells most."""
