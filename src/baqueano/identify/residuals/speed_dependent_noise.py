"""Noise that grows with speed: gears, wheels and floor shake a vehicle the more, the faster it goes.

    σ(v)² = σ₀² + (σ₁ v)² = σ₀² (1 + (κ v)²)                                                              (1)
    κ = arg min Σ_t log σ(v_t) + ½ min((r_t / σ(v_t))², FAR²),   σ₀(κ) = spread of r / √(1 + (κ v)²)       (2)

per channel, v the speed of the model. (2) is the likelihood of a scale, in which an outlier is far and no more;
κ = 0 is among its choices. The profile √(1 + (κ v)²) is told with mean square 1, so that σ is that of the run.
It stays what it is while the parameters are searched: weights that followed the fitted speed would make it
worth while to be fast.
"""

from collections.abc import Sequence

import numpy as np

from baqueano.identify.residuals.huber import spread

RATIOS = np.array([0.0, *np.geomspace(0.125, 32.0, 17)])  # κ times the root mean square of the speed
FAR = 3.0  # standard deviations
ENOUGH = 50  # measurements of a channel, below which its noise is taken for steady
GAIN = 5.0  # of the log-likelihood, that a growth must bring to be believed


def spread_and_profile(
    left: Sequence[np.ndarray], has: Sequence[np.ndarray], speeds: Sequence[np.ndarray], floor: np.ndarray
) -> tuple[np.ndarray, list[np.ndarray]]:
    """σ (m,), and its profile (N, m) per piece, of residuals (N, m) at speeds (N,)."""
    v = np.concatenate(speeds)
    typical = max(float(np.sqrt(np.mean(v**2))), 1e-9)
    profile = [np.ones_like(r) for r in left]
    sigma = np.zeros(len(floor))
    for c in range(len(floor)):
        there = [w[:, c] > 0.0 for w in has]
        r = np.concatenate([x[t, c] for x, t in zip(left, there, strict=True)])
        at = np.concatenate([x[t] for x, t in zip(speeds, there, strict=True)])
        kappa = _growth(r, at, typical, floor[c]) / typical if len(r) >= ENOUGH else 0.0
        mean = np.sqrt(1.0 + kappa**2 * np.mean(at**2)) if len(at) else 1.0
        for k, x in enumerate(speeds):
            profile[k][:, c] = np.sqrt(1.0 + (kappa * x) ** 2) / mean
        scaled = [(x[:, c] / p[:, c])[:, None] for x, p in zip(left, profile, strict=True)]
        sigma[c] = spread(scaled, [w[:, c : c + 1] for w in has], floor[c : c + 1])[0]
    return sigma, profile


def _growth(r: np.ndarray, v: np.ndarray, typical: float, floor: float) -> float:
    """κ times `typical` of (2)."""
    costs = []
    for ratio in RATIOS:
        g = np.sqrt(1.0 + (ratio * v / typical) ** 2)
        base = spread([(r / g)[:, None]], [np.ones((len(r), 1))], np.array([floor]))[0]
        far = np.minimum((r / (base * g)) ** 2, FAR**2)
        costs.append(float(np.sum(np.log(g)) + 0.5 * np.sum(far)) + len(r) * np.log(base))
    best = int(np.argmin(costs))
    return float(RATIOS[best]) if costs[0] - costs[best] > GAIN else 0.0
