"""What hypotheses explain at best: screening, least squares, refinement in the simulator, the noise."""
