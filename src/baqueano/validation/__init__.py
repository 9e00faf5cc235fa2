"""Validate a fit on data that it did not use.

held_out          errors of a simulation of held-out runs, against the noise
cost_advice       the cost that these errors recommend
noise_comparison  noise matrices of a filter, on held-out runs
parameter_drift   parameters run by run, and the ones that changed
"""
