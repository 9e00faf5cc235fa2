"""Define a wrong estimate: its error is many standard errors and a visible fraction of the truth."""

import numpy as np

MAX_STANDARD_ERRORS, MAX_RELATIVE_ERROR = 5.0, 0.05  # standard errors, and part of the true value


def wrong_mask(estimate: np.ndarray, std: np.ndarray, truth: np.ndarray) -> np.ndarray:
    """Return a mask (p,), True for each wrong parameter, and False if its error is not finite."""
    distance = np.abs(estimate - truth)
    return (
        np.isfinite(distance)
        & (distance > MAX_STANDARD_ERRORS * np.where(np.isfinite(std), std, 0.0))
        & (distance > MAX_RELATIVE_ERROR * np.abs(truth))
    )
