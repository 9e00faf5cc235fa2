"""Minimise a cost without derivatives, by steps along the axes and between them.

The search changes one entry after the other, up and down, then pairs in opposite directions. It halves its steps when
the cost does not decrease.
"""

from collections.abc import Callable

import numpy as np

STEPS = (2.0, 1.0, 0.5, 0.25, 0.125)  # for entries that are logarithms
EXCHANGE_STEP = 0.5


def coordinate_search(
    cost: Callable[[np.ndarray], float], q: np.ndarray, low: np.ndarray, high: np.ndarray
) -> np.ndarray:
    """Return the q (n,) between `low` and `high` at which no step of STEPS[-1] reduces the cost by over 0.001. A step
    changes one entry. A step of EXCHANGE_STEP or less can also raise one entry and lower another, because two noises
    can explain the same error."""
    min_cost, axes = cost(q), np.eye(len(q))
    directions = [sign * axis for axis in axes for sign in (1.0, -1.0)]
    exchanges = [a - b for i, a in enumerate(axes) for j, b in enumerate(axes) if i != j]
    for step in STEPS:
        is_improved = True
        while is_improved:
            is_improved = False
            for direction in directions if step > EXCHANGE_STEP else directions + exchanges:
                trial = np.clip(q + step * direction, low, high)
                trial_cost = cost(trial) if np.any(trial != q) else np.inf
                if trial_cost < min_cost - 1e-3:
                    q, min_cost, is_improved = trial, trial_cost, True
    return q
