"""Compare estimators, controllers and guides on the same drives: one table, with intervals of their differences.

result = sweep(vehicle_file, routes=eight(1.0, 0.25), controllers=["kanayama", "lqr"], seeds=range(10))
print(result.table())
result.to_pandas()                # a row per combination and drive
"""

from typing import TYPE_CHECKING

from baqueano.on_demand import on_demand

if TYPE_CHECKING:
    from baqueano.sweep.grid import sweep
    from baqueano.sweep.result import SweepCombination, SweepDrive, SweepResult

__all__ = ["SweepCombination", "SweepDrive", "SweepResult", "sweep"]

__getattr__ = on_demand(
    __name__, {"grid": ("sweep",), "result": ("SweepResult", "SweepCombination", "SweepDrive")}
)
