"""Runs → errors and consistency: how far off, and did the filter know it.

compare(runs).table()      # ATE, RPE, across the path, NEES, NIS with their χ² bands
"""

from baqueano.compare.comparison import Comparison, JudgedPath, compare
from baqueano.compare.consistency import Band

__all__ = ["Band", "Comparison", "JudgedPath", "compare"]
