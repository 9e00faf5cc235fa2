"""Does each channel of a sensor follow its own prediction, another's, or the opposite of its own?

    ρ_ij = correlation of what channel i measured and what the model says of channel j                    (1)

Channels i and j of one sensor are swapped where |ρ_ij| and |ρ_ji| are above 0.7 while |ρ_ii| and |ρ_jj| are
below 0.3; a channel is inverted where ρ_ii is below −0.7. The gains of a fit bend to what was measured, so
that an inverted sensor shows here only where another one contradicts it; else it is the file that does
(against_file.py); and where no fit is left to compare with, the model as the search began with it is asked.
Readings are clipped at 4 standard deviations of their own about the median.
"""

from collections.abc import Sequence

import numpy as np

from baqueano.diagnostics import Diagnostic, Severity, note
from baqueano.identify.solve.huber import MAD
from baqueano.identify.solve.problem import Problem

CLEAR, NONE = 0.7, 0.3
ENOUGH = 50  # samples
MOST = 2000  # and about so many are looked at, evenly: ρ is known to 1/√n
FAR = 4.0
RAN_AWAY = 1e100  # what a model says that no longer is one


def checked(problem: Problem, theta: np.ndarray) -> list[Diagnostic]:
    """Swapped and inverted channels."""
    out, h = [], problem.predictions(theta)
    for name in problem.names:
        out += _of_sensor(name, _all(problem, h, name))
    return out


def correlations(problem: Problem, theta: np.ndarray, name: str) -> np.ndarray:
    """ρ (m, m) of the channels of one sensor at θ (p,).  (1)"""
    return _all(problem, problem.predictions(theta), name)


def clipped(x: np.ndarray) -> np.ndarray:
    """x (n,), drawn to FAR standard deviations about the median, told by the median too."""
    middle = float(np.median(x))
    size = FAR * max(MAD * float(np.median(np.abs(x - middle))), 0.1 * float(np.std(x)))
    return np.clip(x, middle - size, middle + size)


def _all(problem: Problem, h: Sequence[np.ndarray], name: str) -> np.ndarray:
    k = problem.names.index(name)
    span = range(sum(problem.sizes[:k]), sum(problem.sizes[: k + 1]))
    rho, known = np.zeros((len(span), len(span))), {}
    for a, i in enumerate(span):
        there = [np.flatnonzero(has[:, i] > 0.0) for has in problem.has]
        every = max(1, sum(map(len, there)) // MOST)
        x = np.concatenate([z[rows[::every], i] for z, rows in zip(problem.z, there, strict=True)])
        for b, j in enumerate(span):
            y = np.concatenate([p[rows[::every], j] for p, rows in zip(h, there, strict=True)])
            rho[a, b] = _correlation(x, y, known)
    return rho


def _of_sensor(name: str, rho: np.ndarray) -> list[Diagnostic]:
    out = []
    for i in range(len(rho)):
        if rho[i, i] < -CLEAR:
            out.append(
                note("axes.inverted", Severity.ERROR, subject=f"{name}[{i}]", correlation=float(rho[i, i]))
            )
        for j in range(i):
            crossed = min(abs(rho[i, j]), abs(rho[j, i])) > CLEAR
            if crossed and max(abs(rho[i, i]), abs(rho[j, j])) < NONE:
                out.append(
                    note(
                        "axes.swapped",
                        Severity.ERROR,
                        subject=f"{name}[{j}]",
                        other=f"{name}[{i}]",
                        first=float(rho[j, i]),
                        second=float(rho[i, j]),
                    )
                )
    return out


def _correlation(x: np.ndarray, y: np.ndarray, known: dict[bytes, tuple[np.ndarray, float]]) -> float:
    """ρ of what was measured and what is said (n,), 0 where that is too little or nothing moves; `known` is what
    was `_bounded` before.  (1)"""
    good = np.isfinite(x) & (np.abs(y) < RAN_AWAY)
    if good.sum() < ENOUGH:
        return 0.0
    (x, x_size), (y, y_size) = (_bounded(v[good], known) for v in (x, y))
    sizes = x_size * y_size
    return float(np.mean(x * y) / sizes) if sizes > 1e-12 else 0.0


def _bounded(x: np.ndarray, known: dict[bytes, tuple[np.ndarray, float]]) -> tuple[np.ndarray, float]:
    """x about its mean, clipped, and its standard deviation."""
    key = x.tobytes()
    if key not in known:
        x = clipped(x)
        known[key] = x - x.mean(), float(np.std(x))
    return known[key]
