"""Transfer of policies across a dynamics mismatch: a benchmark, and a tool that explains the mismatch."""
