"""Search for the parameters of least cost while the noise itself is estimated.

    σ ← spread of the residuals at θ,   θ ← arg min C(θ; σ),   until σ settles                            (1)

The search begins with the σ of a model that is still wrong, which makes the Huber cost almost quadratic. It ends with
the σ of the noise. If the residuals are autocorrelated and large, or the search got stuck, it begins again until two
searches end at the same place. The new starts are vehicles without motor force, with less and with more friction. The
best end is returned.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from baqueano.identify.covariance.information import WHITE_LIMIT, autocorrelation_sums
from baqueano.identify.estimation.least_squares import MOST, Minimiser, Solution, minimise
from baqueano.identify.residuals.noise_level import informative_rows, spread
from baqueano.identify.residuals.simulation import Residuals
from baqueano.messages.language import translate as _

ROUNDS = 15  # of σ
SETTLED = 5e-3  # relative change of σ below which it is final
NEAR = 0.2  # relative change below which the next round is run to its end
ROUGH, FINE = 1e-1, 1e-7  # decrements while σ is still moving, and at the end
PATIENCE = 20  # evaluations while σ is still moving
GAINS = ("actuator_matrix", "velocity_matrix", "throttle_gain")
LACKING = 0.14  # of a channel's own spread: with larger autocorrelated residuals a search is not sound
SAME = 1e-3  # of the logarithm of σ: closer ends count as the same
TWICE = 0.7  # of the logarithm of σ: a rough end that is worse by more is dropped
AGAIN = (1.0, 0.25, 4.0)  # factors on all but the gains, if the search begins again without force


class Task(NamedTuple):
    """A search: its residuals, bounds and noise."""

    problem: Residuals
    first: np.ndarray  # (p,) θ at the start
    low: np.ndarray  # (p,)
    high: np.ndarray  # (p,)
    floor: np.ndarray  # (m,) least σ
    fixed_sigma: np.ndarray | None  # (m,) σ, if it is known
    by_speed: bool = False  # True if the noise may grow with speed: noise_level.py
    progress: Callable[[str], object] | None = (
        None  # receives the progress; if it returns True, the search ends
    )
    prior_sigma: np.ndarray | None = None  # (m,) σ of channels with too few measurements to find it, else 0
    again: bool = True  # True if a search that is not sound begins again; False for refused data
    minimise: Minimiser = minimise  # finds the least cost of one σ


class Search(NamedTuple):
    """Result of a search."""

    problem: Residuals  # weighted with the estimated noise
    solution: Solution
    sigma: np.ndarray  # (m,)
    autocorrelation: np.ndarray  # (m,) `autocorrelation_sums` of the residuals
    evaluations: int
    profile: list[np.ndarray] | None = None  # per segment (N, m), of mean square 1: relative σ if it varies
    stopped: bool = False  # True if the caller requested to stop; not converged if there was more to do

    def sound(self, signal: np.ndarray) -> bool:
        """Return True if the search converged and the residuals are not both autocorrelated and large. `signal` (m,)
        contains the standard deviations of the channels."""
        lacking = (np.abs(self.autocorrelation) > WHITE_LIMIT) & (self.sigma > LACKING * signal)
        return self.solution.converged and not lacking.any()

    def badness(self, counts: np.ndarray) -> float:
        """Return the logarithm of the residual spread over all samples, by which searches are compared. It is
        infinite if the model diverged."""
        log_sigma = float(counts @ np.log(self.sigma))
        return log_sigma if np.isfinite(log_sigma) and np.isfinite(self.solution.evaluation.cost) else np.inf


def best_search(task: Task, begin: np.ndarray) -> Search:
    """Return the search from `begin` (p,). If it is not sound, return the best of several searches."""
    best = search(task, begin)
    signal, counts = task.problem.signal(), np.sum([has.sum(axis=0) for has in task.problem.has], axis=0)
    gains = np.array(
        [path.partition("[")[0].endswith(GAINS) for path in task.problem.shape.shared], dtype=bool
    )
    for factor in AGAIN if gains.any() and task.again else ():
        if best.stopped or best.sound(signal):
            break
        theta = task.first.copy()
        theta[: len(gains)] = np.where(gains, 0.0, factor * theta[: len(gains)])
        second = search(task, np.clip(theta, task.low, task.high), rough=True)
        if not second.stopped and second.badness(counts) - best.badness(counts) < TWICE * counts.sum():
            whole = search(task, second.solution.theta, None, second)
            second = whole._replace(evaluations=whole.evaluations + second.evaluations)
        gain = (best.badness(counts) - second.badness(counts)) / counts.sum()
        evaluations = best.evaluations + second.evaluations
        best = (second if gain > SAME else best)._replace(evaluations=evaluations, stopped=second.stopped)
        if abs(gain) <= SAME:
            break  # two searches ended at the same place
    return best


def search(
    task: Task,
    theta: np.ndarray,
    fixed: np.ndarray | None = None,
    previous: Search | None = None,
    rough: bool = False,
) -> Search:
    """Return one search from `theta` (p,). The entries `fixed` (p,) do not move. The search begins with the σ of
    `previous` if given.  (1)

    `rough` ends the search when σ changes little.
    """
    problem, sigma_fixed = task.problem, task.fixed_sigma is not None
    damping = 1e-2 if previous is None else 1e-6
    if previous is not None:
        sigma, profile = previous.sigma, previous.profile
    else:
        sigma, profile = (
            sigma_at(task, problem, theta) if task.fixed_sigma is None else (task.fixed_sigma, None)
        )
    count, turn, near, reason = 0, 1, sigma_fixed, False
    while True:
        problem = problem.weight(sigma, profile)
        near = near or turn == ROUNDS
        solution = task.minimise(
            problem.evaluate, theta, task.low, task.high, fixed=fixed, damping=damping,
            tolerance=FINE if near else ROUGH, most=MOST if near else PATIENCE,
        )  # fmt: skip
        theta, count, damping = solution.theta, count + solution.evaluations, 1e-6
        if task.progress is not None:
            reason = (
                task.progress(
                    _(
                        "round {turn}: {count} evaluations, cost {cost:.6g}",
                        turn=turn,
                        count=count,
                        cost=solution.evaluation.cost,
                    )
                )
                is True
            )
        if sigma_fixed or turn == ROUNDS or not np.isfinite(solution.evaluation.cost):
            break
        now, profile = sigma_at(task, problem, theta)
        change = float(np.max(np.abs(np.log(now / sigma))))
        if (near and change < SETTLED) or (rough and change < NEAR):
            break
        if reason:
            solution = solution._replace(converged=False)
            break
        sigma, near, turn = now, change < NEAR, turn + 1
    autocorrelation = autocorrelation_sums(problem.residuals(solution.theta), problem.has)
    return Search(problem, solution, problem.sigma, autocorrelation, count, profile, reason)


def sigma_at(task: Task, problem: Residuals, theta: np.ndarray) -> tuple[np.ndarray, list[np.ndarray] | None]:
    """Return σ (m,) of the residuals at θ, and its profile (N, m) per segment or None. If the model diverges, return
    the spread of the measurements."""
    residuals, profile = problem.misfits(theta), None
    if not all(np.isfinite(r).all() for r in residuals):
        sigma = spread(problem.z, problem.has, task.floor)
    elif task.by_speed:
        sigma, profile = problem.spread_and_profile(residuals, theta, task.floor)
    else:
        sigma = spread(residuals, informative_rows(residuals, problem.has, problem.z), task.floor)
    if task.prior_sigma is not None:
        sigma = np.where(task.prior_sigma > 0.0, task.prior_sigma, sigma)
    return sigma, profile
