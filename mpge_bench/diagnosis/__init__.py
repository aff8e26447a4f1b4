"""Compare a simulator with recordings of the real system: locate the mismatch, name the physics that was left out, show that the fit improves."""
