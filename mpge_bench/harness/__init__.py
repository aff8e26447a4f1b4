"""The evaluation harness: metrics, runs, sweeps and their results."""
