"""The definition of a wrong estimate: off by many standard errors and by a visible part of the truth."""

import numpy as np

ERRORS, PART = 5.0, 0.05  # standard errors, and part of the true value


def wrong(estimate: np.ndarray, sd: np.ndarray, truth: np.ndarray) -> np.ndarray:
    """Return (p,) bool: True for each wrong parameter; False if its error is not known."""
    off = np.abs(estimate - truth)
    return (
        np.isfinite(off) & (off > ERRORS * np.where(np.isfinite(sd), sd, 0.0)) & (off > PART * np.abs(truth))
    )
