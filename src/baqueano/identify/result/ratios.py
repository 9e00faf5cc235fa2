"""Shares and ratios for people."""

import numpy as np

from baqueano.language import number
from baqueano.language import translated as _


def percent(part: float, digits: int = 1) -> str:
    """A share of a variance for people: below −100 % the figure says no more than that, and NaN is "-"."""
    if np.isnan(part):
        return "-"
    return f"{number(100.0 * part):.{digits}f} %" if part > -1.0 else _("below -100 %")


def times(ratio: float) -> str:
    """Return "2.1×" for people; "-" for NaN."""
    if np.isnan(ratio):
        return "-"
    return f"{number(ratio):.2f}×" if ratio < 1e3 else _("over 1000×")
