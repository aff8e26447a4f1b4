"""Diagnosis of a benchmark pair, or of any robot of the suite, from transitions (s, a, s') of its target: whole states, told row by row.

data (episodes) -> predict (replay) -> hypotheses -> fit -> choose -> verdict, each from a frozen value to a frozen value, as with recordings of a rig.
"""
