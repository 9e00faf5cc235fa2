"""Test for duties in steps: the motors got the nearest step of a timer, not the duty of the log.

A timer of 8 bits rounds a duty to 1/255. Behind a dead zone of 0.3 that is a part of 1 % of what is left of a command,
another one at each level, and on a small robot more than the noise of its gyro. The steps are known but for their
size, so no parameter is spent:

    C(θ; u) − C(θ; steps · round(u / steps)) > CLEAR                                                      (1)

at the θ that was fitted without them, C the Huber cost in standard deviations. e^CLEAR is the odds that they give.
"""

import numpy as np

from baqueano.contracts.values import Tree
from baqueano.identify.blocks import FittedBlocks
from baqueano.identify.residuals.simulation import Residuals
from baqueano.vehicles.drivetrain import mix, quantised

PATH = "model.drivetrain.duty_step"
TIMERS = (255, 100, 1023)  # 8 bits, per cent, 10 bits
CLEAR = 25.0


def duty_step(blocks: FittedBlocks, problem: Residuals, theta: np.ndarray) -> int | None:
    """Return how many steps the duties seem to have; None if none are seen, or the file tells.  (1)"""
    drivetrain: Tree = getattr(blocks.model, "drivetrain", None)
    n = blocks.model.commands
    if getattr(drivetrain, "mixing", "none") != "two_wheels" or drivetrain.duty_step > 0.0:
        return None
    if max(float(np.max(np.abs(u[:, 0]) + np.abs(u[:, 2]))) for u in (r.u for r in problem.records)) > 2.0:
        return None  # no duties

    def rounded(steps: int, rows: np.ndarray) -> np.ndarray:
        left, right = quantised(mix("two_wheels", rows[:, 1 : 1 + n].T), 1.0 / steps)
        u = np.stack([0.5 * (left + right), rows[:, 2], 0.5 * (right - left)], axis=1)
        return np.concatenate([rows[:, :1], u, rows[:, 1 + n :]], axis=1)

    before = problem.cost(theta, lambda rows: rows)
    gains = {steps: before - problem.cost(theta, lambda rows, k=steps: rounded(k, rows)) for steps in TIMERS}
    best = max(gains, key=lambda steps: gains[steps])
    return best if gains[best] > CLEAR else None
