"""Search for the parameters of least cost while the noise itself is estimated.

    σ ← spread of the residuals at θ,   θ ← arg min C(θ; σ),   until σ is constant                            (1)

The search begins with the σ of a model that is still wrong, which makes the Huber cost almost quadratic. It ends with
the σ of the noise. If the residuals are autocorrelated and large, or the search did not converge, it is repeated. It
ends when two searches from different starts agree. The new starts are vehicles without motor force, with less and
with more friction. The best result is returned.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from baqueano.identify.residuals.informative_rows import informative_rows
from baqueano.identify.residuals.simulation import Residuals
from baqueano.messages.language import translate as _
from baqueano.numerics.autocorrelation import WHITE_LIMIT, autocorrelation_sums
from baqueano.numerics.least_squares import MAX_EVALUATIONS, Minimiser, Solution, minimise
from baqueano.numerics.noise_level import robust_sigma

MAX_ROUNDS = 15  # of σ
SIGMA_TOLERANCE = 5e-3  # relative change of σ below which it is final
NEAR_CHANGE = 0.2  # relative change below which the next round is run to its end
ROUGH_DECREMENT, FINE_DECREMENT = 1e-1, 1e-7  # decrements while σ is still moving, and at the end
ROUND_EVALUATIONS = 20  # evaluations while σ is still moving
GAIN_NAMES = ("actuator_matrix", "velocity_matrix", "throttle_gain")
MAX_RESIDUAL_SHARE = 0.14  # of a channel's spread: with larger autocorrelated residuals a search is not sound
EQUAL_LOG_SIGMA = 1e-3  # difference of the logarithm of σ: results that are closer are treated as equal
DROPPED_LOG_SIGMA = 0.7  # difference of the logarithm of σ: a rough result that is worse by more is dropped
RESTART_FACTORS = (1.0, 0.25, 4.0)  # factors on all but the gains, if the search begins again without force


class Task(NamedTuple):
    """A search: its residuals, bounds and noise."""

    problem: Residuals
    start: np.ndarray  # (p,) θ at the start
    low: np.ndarray  # (p,)
    high: np.ndarray  # (p,)
    floor: np.ndarray  # (m,) least σ
    fixed_sigma: np.ndarray | None  # (m,) σ, if it is known
    has_speed_noise: bool = False  # True if the noise can grow with speed: numerics/noise_level.py
    # receives the progress; if it returns True, the search ends
    progress: Callable[[str], object] | None = None
    # (m,) σ of channels with too few measurements to estimate it, else 0
    prior_sigma: np.ndarray | None = None
    retry: bool = True  # True if a search that is not sound begins again; False for refused data
    minimise: Minimiser = minimise  # finds the least cost of one σ


class Search(NamedTuple):
    """Result of a search."""

    problem: Residuals  # weighted with the estimated noise
    solution: Solution
    sigma: np.ndarray  # (m,)
    autocorrelation: np.ndarray  # (m,) `autocorrelation_sums` of the residuals
    evaluations: int
    profile: list[np.ndarray] | None = None  # per segment (N, m), of mean square 1: relative σ if it varies
    # True if the caller ended the search; then it is not converged unless it was complete
    stopped: bool = False

    def is_sound(self, signal: np.ndarray) -> bool:
        """Return True if the search converged and the residuals are not both autocorrelated and large. `signal` (m,)
        contains the standard deviations of the channels."""
        is_unexplained = (np.abs(self.autocorrelation) > WHITE_LIMIT) & (
            self.sigma > MAX_RESIDUAL_SHARE * signal
        )
        return self.solution.converged and not is_unexplained.any()

    def log_sigma_sum(self, counts: np.ndarray, channels: slice = slice(None)) -> float:
        """Return Σ counts log σ over the `channels`, by which searches are compared; infinite if the model diverged."""
        log_sigma = float(counts @ np.log(self.sigma[channels]))
        return log_sigma if np.isfinite(log_sigma) and np.isfinite(self.solution.evaluation.cost) else np.inf


def best_search(task: Task, begin: np.ndarray) -> Search:
    """Return the search from `begin` (p,). If its result is not plausible, return the best of several searches."""
    best_fit = search(task, begin)
    signal, counts = task.problem.signal_std(), task.problem.counts
    fields = [path.partition("[")[0] for path in task.problem.shape.shared_paths]
    is_gain = np.array([field.endswith(GAIN_NAMES) for field in fields], dtype=bool)
    for factor in RESTART_FACTORS if is_gain.any() and task.retry else ():
        if best_fit.stopped or best_fit.is_sound(signal):
            break
        theta = task.start.copy()
        theta[: len(is_gain)] = np.where(is_gain, 0.0, factor * theta[: len(is_gain)])
        second_fit = search(task, np.clip(theta, task.low, task.high), rough=True)
        excess = (second_fit.log_sigma_sum(counts) - best_fit.log_sigma_sum(counts)) / counts.sum()
        if not second_fit.stopped and excess < DROPPED_LOG_SIGMA:
            refined_fit = search(task, second_fit.solution.theta, None, second_fit)
            second_fit = refined_fit._replace(evaluations=refined_fit.evaluations + second_fit.evaluations)
        gain = (best_fit.log_sigma_sum(counts) - second_fit.log_sigma_sum(counts)) / counts.sum()
        evaluations = best_fit.evaluations + second_fit.evaluations
        best_fit = second_fit if gain > EQUAL_LOG_SIGMA else best_fit
        best_fit = best_fit._replace(evaluations=evaluations, stopped=second_fit.stopped)
        if abs(gain) <= EQUAL_LOG_SIGMA:
            break  # two searches ended at the same place
    return best_fit


def search(
    task: Task,
    theta: np.ndarray,
    is_fixed: np.ndarray | None = None,
    previous: Search | None = None,
    rough: bool = False,
) -> Search:
    """Return one search from `theta` (p,). Entries in the mask `is_fixed` (p,) do not change. The search begins with
    the σ of `previous` if it is given. (1) If `rough`, the search ends when σ changes by less than NEAR_CHANGE."""
    problem, sigma_fixed = task.problem, task.fixed_sigma is not None
    damping = 1e-2 if previous is None else 1e-6
    if previous is not None:
        sigma, profile = previous.sigma, previous.profile
    elif task.fixed_sigma is not None:
        sigma, profile = task.fixed_sigma, None
    else:
        sigma, profile = sigma_at(task, problem, theta)
    count, round_number, is_near, is_stopped = 0, 1, sigma_fixed, False
    while True:
        problem = problem.weight(sigma, profile)
        is_near = is_near or round_number == MAX_ROUNDS
        solution = task.minimise(
            problem.evaluate, theta, task.low, task.high, is_fixed=is_fixed, damping=damping,
            tolerance=FINE_DECREMENT if is_near else ROUGH_DECREMENT,
            max_evaluations=MAX_EVALUATIONS if is_near else ROUND_EVALUATIONS,
        )  # fmt: skip
        theta, count, damping = solution.theta, count + solution.evaluations, 1e-6
        if task.progress is not None:
            figures = {"turn": round_number, "count": count, "cost": solution.evaluation.cost}
            text = _("round {turn}: {count} evaluations, cost {cost:.6g}", **figures)
            is_stopped = task.progress(text) is True
        if sigma_fixed or round_number == MAX_ROUNDS or not np.isfinite(solution.evaluation.cost):
            break
        new_sigma, profile = sigma_at(task, problem, theta)
        change = float(np.max(np.abs(np.log(new_sigma / sigma))))
        is_unfinished = is_near and not solution.converged and solution.evaluations >= MAX_EVALUATIONS
        if (is_near and change < SIGMA_TOLERANCE and not is_unfinished) or (rough and change < NEAR_CHANGE):
            break
        if is_stopped:
            solution = solution._replace(converged=False)
            break
        sigma, is_near, round_number = new_sigma, change < NEAR_CHANGE, round_number + 1
    autocorrelation = autocorrelation_sums(problem.residuals(solution.theta), problem.masks)
    return Search(problem, solution, problem.sigma, autocorrelation, count, profile, is_stopped)


def sigma_at(task: Task, problem: Residuals, theta: np.ndarray) -> tuple[np.ndarray, list[np.ndarray] | None]:
    """Return σ (m,) of the residuals at θ (of the measurements if the model diverges), and its profiles (N, m)."""
    residuals, profile = problem.misfits(theta), None
    if not all(np.isfinite(r).all() for r in residuals):
        sigma = robust_sigma(problem.z, problem.masks, task.floor)
    elif task.has_speed_noise:
        sigma, profile = problem.sigma_and_profile(residuals, theta, task.floor)
    else:
        sigma = robust_sigma(residuals, informative_rows(residuals, problem.masks, problem.z), task.floor)
    if task.prior_sigma is not None:
        sigma = np.where(task.prior_sigma > 0.0, task.prior_sigma, sigma)
    return sigma, profile
