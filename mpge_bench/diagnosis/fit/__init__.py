"""What hypotheses explain at best: screening, least squares, refinement in PyBullet, the noise."""
