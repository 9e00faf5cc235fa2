"""Define θ.

free    free parameters: paths of the vehicle file, with bounds and units
theta   their indices in θ, which also has entries of each run and segment, and the rows of the fit
"""
