"""Format shares and ratios as text."""

import numpy as np

from baqueano.messages.language import number
from baqueano.messages.language import translate as _


def percent(part: float, digits: int = 1) -> str:
    """Return a share of a variance as text: "-" for NaN, and "below -100 %" in place of a smaller value."""
    if np.isnan(part):
        return "-"
    return f"{number(100.0 * part):.{digits}f} %" if part > -1.0 else _("below -100 %")


def times(ratio: float) -> str:
    """Return a ratio as text, such as "2.1×"; "-" for NaN."""
    if np.isnan(ratio):
        return "-"
    return f"{number(ratio):.2f}×" if ratio < 1e3 else _("over 1000×")
