"""Compare runs: errors of the estimate and of the vehicle, and the consistency of the filter.

compare(runs).table()      # ATE, RPE, cross-track error, NEES and NIS with their χ² bands
"""

from typing import TYPE_CHECKING

from baqueano.compare.comparison import Comparison, RunComparison
from baqueano.compare.consistency import Band
from baqueano.compare.front import compare
from baqueano.on_demand import on_demand

if TYPE_CHECKING:
    from baqueano.compare.corridor_forecast import CorridorForecast

__all__ = ["Comparison", "compare"]

__getattr__ = on_demand(__name__, {"corridor_forecast": ("CorridorForecast",)})
