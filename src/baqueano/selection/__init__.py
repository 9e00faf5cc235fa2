"""Choose the terms of a model by its simulation error on held-out data.

choose             the search: add the terms that help, drop those that do not
cross_validation   folds of the runs, and the paired comparison of two models
terms              the optional terms of a vehicle, with their neutral values
choice             the result
"""
