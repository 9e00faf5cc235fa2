"""Turn a finished search into a `Fit`: names, error bars, findings and verdict.

assemble          all parts of the fit
verdict           USABLE, WARN or REFUSED, with reasons
fit_result        `Fit`: its numbers and its table
to_vehicle_file   the changed vehicle file
objective_choice  the choice between the results of two costs
"""
