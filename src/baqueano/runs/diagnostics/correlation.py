"""How two signals of a recording go together."""

import numpy as np

ENOUGH = 50  # windows
CLEAR, NONE = 0.7, 0.3  # correlations that are one, and that are none


def relation(x: np.ndarray, y: np.ndarray) -> tuple[float, float]:
    """Slope of y over x by least squares, and their correlation; 0 where one of them is constant or not finite."""
    x, y = x - np.mean(x), y - np.mean(y)
    xx, yy, xy = float(x @ x), float(y @ y), float(x @ y)
    if not 0.0 < xx * yy < np.inf:
        return 0.0, 0.0
    return xy / xx, xy / np.sqrt(xx * yy)
