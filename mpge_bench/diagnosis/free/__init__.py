"""Diagnosis of what moves freely or touches something, from recordings: predicted in short windows by the simulator itself, from starts that are fitted.

data (motion) -> predict (windows) -> hypotheses -> fit -> choose -> verdict; hypotheses, fits and choices are those of transitions.
"""
