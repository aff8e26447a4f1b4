"""Transfer of policies across a dynamics mismatch: a benchmark, and a tool that explains the mismatch."""

from mpge_bench import numerics

# Before anything imports numpy.
numerics.fix()
