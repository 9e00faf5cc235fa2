"""Tune the gains of a vehicle file's controller on its identified model.

result = tune(vehicle_file, route)
print(result.table())
result.save()                    # writes the gains into the vehicle file
"""

from baqueano.tune.gains import tune
from baqueano.tune.tune_result import TuneResult

__all__ = ["TuneResult", "tune"]
