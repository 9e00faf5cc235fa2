"""Compare models of one vehicle by their simulation error on held-out data.

    L_b = Σ_{t in block b} 2ρ((z_t − h_t(θ̂_k)) / σ),   ρ Huber's, σ of the model to beat                    (1)
    g_b = ½ log (L_b(without) + c n_b) / (L_b(with) + c n_b),   n_b measurements, c = MIN_NOISE_SHARE      (2)
    "with" is better if mean g / (std g / √B) > t_{1−α, B−1}, and Σ L_b(with) < Σ L_b(without)                 (3)
    pieces = Σ_runs min(1 + turning points, max(1, T / SHORT_BLOCK_S)),  2^−pieces ≤ α ⟺ pieces ≥ MIN_SIGNS     (4)

Fold k holds out every K-th block, and GAP_S on either side is not used. With FOLDS runs or more it holds out
whole runs, whose biases and starts are estimated on them. Runs that the user holds out are the only fold. A block has
5 s, or 2 s with few blocks: longer than the memory of a small vehicle, so that sums are independent. (3) is a paired
t test on logarithms, because gains differ by orders of magnitude between blocks. c limits the effect of errors below
a third of the noise. A term without effect fits noise, so that mean g < 0 and the error rate of the test is below α.
(4) counts independent segments of motion by the extrema of a command; smaller changes than MIN_CHANGE_RATIO are noise
(Bienaymé 1874). MIN_SIGNS is what the sign test requires.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from baqueano.errors import UsageError
from baqueano.identify.data.record import FitRecord, FittedBlocks
from baqueano.identify.parameters.theta import ThetaShape
from baqueano.identify.residuals.simulation import Residuals
from baqueano.numerics.least_squares import Solution, minimise
from baqueano.numerics.parallel import parallel_map
from baqueano.numerics.statistics import HUBER, change_covariance, student_quantile
from baqueano.runs.run import Run

FOLDS = 5
MIN_RUN_BLOCKS = 20  # from which on a run is a block: with fewer, Student's t is too large
BLOCK_S, SHORT_BLOCK_S, MIN_BLOCK_COUNT, MAX_BLOCKS = 5.0, 2.0, 40, 60
MIN_BLOCKS = 6
MIN_NOISE_SHARE = 0.1  # of the variance of the noise
GAP_S = 1.0  # on both sides of a held-out block
FINAL_DECREMENT = 1e-3  # decrement: every parameter moves by less than 3 % of its standard error
MAX_EVALUATIONS = 25  # evaluations
MIN_CHANGE_RATIO = 0.1
FALSE_ALARM_RATE = 0.05
MIN_SIGNS = int(np.ceil(-np.log2(FALSE_ALARM_RATE)))


class Score(NamedTuple):
    """Prediction errors of a model on held-out data."""

    loss: np.ndarray  # (B, m) of (1)
    samples: np.ndarray  # (B, m) number of samples
    one_step_errors: np.ndarray  # (m,) Σ of squared one-step errors, in σ²
    pairs: np.ndarray  # (m,) their number
    estimates: np.ndarray  # (K, p) shared parameters of each fold
    sigma: np.ndarray  # (m,)

    @property
    def error(self) -> np.ndarray:
        """Return the robust root mean square (m,) of the simulation error, in the units of the channels."""
        return self.sigma * np.sqrt(self.loss.sum(axis=0) / np.maximum(self.samples.sum(axis=0), 1.0))

    @property
    def one_step(self) -> np.ndarray:
        """Return the root mean square (m,) of the error one sample ahead, in the units of the channels."""
        return self.sigma * np.sqrt(self.one_step_errors / np.maximum(self.pairs, 1.0))


class PairedComparison(NamedTuple):
    """Comparison of two models on the same blocks."""

    gain: float  # relative fall of the error of a block, mean g
    std: float  # its standard error
    errors: float  # mean g in standard errors; −inf if a model diverges, at most 0 without a lower total loss
    channel: int  # channel with the largest share of the change
    blocks: int

    def critical_value(self, alpha: float) -> float:
        """Return the critical value t_{1−α} for mean g in standard errors."""
        return student_quantile(1.0 - alpha, max(5, self.blocks - 1))


class Fold(NamedTuple):
    """Data of one fold: the data of the fit, and the held-out data."""

    training_residuals: Residuals
    test: Residuals


class HeldOutFolds:
    """The cross-validation folds of the runs, for one structure of model."""

    def __init__(
        self, blocks: FittedBlocks, shape: ThetaShape, records: Sequence[FitRecord], begins_at_rest: Sequence[bool],
        held_out_count: int = 0,
        backend: str = "auto",
    ) -> None:  # fmt: skip
        """Make the folds: the last `held_out_count` runs of `records` are held out. If `held_out_count` is 0, each fold
        holds out other blocks, or other whole runs if there are FOLDS runs or more. `begins_at_rest` marks the runs
        that begin at rest. The caller sets the bounds of θ, `low` and `high`."""
        self.low, self.high = np.zeros(0), np.zeros(0)
        fitted_runs = len(begins_at_rest) - held_out_count
        self.unseen, self.whole_runs = held_out_count, bool(held_out_count) or fitted_runs >= FOLDS
        test_records = [record for record in records if not held_out_count or record.run >= fitted_runs]
        are_runs_blocks = (held_out_count or fitted_runs) >= MIN_RUN_BLOCKS
        self.block_s, block_numbers, self.count = _blocks(test_records, are_runs_blocks)
        fitted_blocks = [
            np.zeros(len(record.dt_s), int) for record in records[: len(records) - len(test_records)]
        ]
        self.blocks = [*fitted_blocks, *block_numbers]
        run_numbers = [np.full(len(r.dt_s), r.run) for r in records]
        is_fitted = [run < fitted_runs if held_out_count else run >= 0 for run in run_numbers]
        fit_records = [r.with_mask(mask) for r, mask in zip(records, is_fitted, strict=True)]
        self.all_residuals = Residuals(blocks, shape, fit_records, backend)
        self.is_shared = np.arange(self.all_residuals.size) < len(shape.shared_paths)
        self.starts = np.arange(self.all_residuals.size) >= self.all_residuals.layout.first_start
        self.is_resting_start = np.zeros(self.all_residuals.size, bool)  # starts that are known to be 0
        for k, record in enumerate(records):
            self.is_resting_start[self.all_residuals.layout.start_slice(k)] = begins_at_rest[record.run]
        self.folds = []
        if held_out_count:
            held_out_records = [r.with_mask(~mask) for r, mask in zip(records, is_fitted, strict=True)]
            self.folds.append(Fold(self.all_residuals, Residuals(blocks, shape, held_out_records, backend)))
            return
        for k in range(min(FOLDS, self.count)):
            groups = run_numbers if self.whole_runs else self.blocks
            is_held_out = [block_number % FOLDS == k for block_number in groups]
            is_excluded = is_held_out
            if not self.whole_runs:
                is_excluded = [_widen(o, r.dt_s) for o, r in zip(is_held_out, records, strict=True)]
            training_residuals = [r.with_mask(~n) for r, n in zip(records, is_excluded, strict=True)]
            test = [r.with_mask(o) for r, o in zip(records, is_held_out, strict=True)]
            self.folds.append(
                Fold(*(Residuals(blocks, shape, part, backend) for part in (training_residuals, test)))
            )

    def fit(
        self, theta: np.ndarray, is_free: np.ndarray, sigma: np.ndarray, problem: Residuals | None = None,
        max_evaluations: int = MAX_EVALUATIONS,
    ) -> Solution:  # fmt: skip
        """Return the best θ (p,) from `theta` on all runs, or on the data of `problem`; only the entries `is_free` (p,)
        change."""
        problem = (self.all_residuals if problem is None else problem).weight(sigma)
        return minimise(
            problem.evaluate, theta, self.low, self.high,
            is_fixed=~is_free, tolerance=FINAL_DECREMENT, max_evaluations=max_evaluations, damping=1e-4,
        )  # fmt: skip

    def score(self, theta: np.ndarray, is_free: np.ndarray, sigma: np.ndarray) -> Score:
        """Return the score on held-out data of a model with the entries `is_free` (p,) of θ; folds start at `theta`.
        (1)"""
        # otherwise each run uses one core
        is_single = len(self.all_residuals.records) == 1 and self.all_residuals.scan.backend == "c"
        rows = sum(map(len, self.blocks)) if is_single else 0
        scores = parallel_map(
            lambda fold: self._score_fold(fold, theta, is_free, sigma), self.folds, rows=rows
        )
        loss, samples, one_step_errors, pairs = (np.sum([s[i] for s in scores], axis=0) for i in range(4))
        return Score(loss, samples, one_step_errors, pairs, np.array([score[4] for score in scores]), sigma)

    def _score_fold(
        self, fold: Fold, theta: np.ndarray, is_free: np.ndarray, sigma: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Return loss, samples, one-step errors and pairs of one fold, and its shared parameters."""
        loss, samples = np.zeros((self.count, len(sigma))), np.zeros((self.count, len(sigma)))
        one_step_errors, pairs = np.zeros(len(sigma)), np.zeros(len(sigma))
        # a start can belong to held-out data
        free_mask = is_free if self.whole_runs else is_free & ~self.starts
        theta_ = self.fit(theta, free_mask, sigma, fold.training_residuals).theta
        shared_theta = theta_[self.is_shared]
        if self.whole_runs:
            theta_ = np.where(self.is_resting_start, 0.0, theta_)
            theta_ = self.fit(
                theta_, is_free & ~self.is_shared & ~self.is_resting_start, sigma, fold.test
            ).theta
        segments = zip(fold.test.weight(sigma).residuals(theta_), fold.test.masks, self.blocks, strict=True)
        for r, mask, block in segments:
            a = np.abs(r)
            np.add.at(loss, block, np.where(a < HUBER, r * r, HUBER * (2.0 * a - HUBER)))
            np.add.at(samples, block, mask)
            for c, steps in enumerate(
                np.diff(x[is_finite]) for x, is_finite in zip(r.T, mask.T > 0.0, strict=True)
            ):
                one_step_errors[c] += np.sum(np.clip(steps, -1e6, 1e6) ** 2)
                pairs[c] += len(steps)
        return np.where(np.isfinite(loss), loss, np.inf), samples, one_step_errors, pairs, shared_theta


def check_only_held_out(held_out: Sequence[Run], runs: Sequence[Run]) -> None:
    """Raise UsageError if a run is both held out and fitted."""
    repeats = [run.name for run in held_out if run in runs]
    if repeats:
        raise UsageError.of("runs.fitted-to", "--held-out RUN", run=repeats[0])


def paired_comparison(base: Score, other_model: Score) -> PairedComparison:
    """Return the comparison of two models, block by block.  (2), (3)"""
    has_samples = base.samples.sum(axis=1) > 0.0
    base_loss, other_loss = base.loss[has_samples], other_model.loss[has_samples]
    floor = MIN_NOISE_SHARE * base.samples[has_samples].sum(axis=1)
    if not (np.isfinite(base_loss).all() and np.isfinite(other_loss).all()):
        return PairedComparison(-np.inf, np.inf, -np.inf, 0, len(floor))
    g = 0.5 * np.log((base_loss.sum(axis=1) + floor) / (other_loss.sum(axis=1) + floor))
    mean, se = float(g.mean()), float(g.std(ddof=1) / np.sqrt(len(g)))
    errors = mean / se if se > 1e-12 else 0.0
    if not other_loss.sum() < base_loss.sum():
        errors = min(errors, 0.0)
    channel = int(np.argmax(np.abs((base_loss - other_loss).sum(axis=0))))
    return PairedComparison(mean, se, errors, channel, len(g))


def jackknife(score: Score, entries: Sequence[int]) -> np.ndarray:
    """Return the standard errors (q,) of shared parameters by leaving folds out. They are also valid for autocorrelated
    residuals, and NaN with a single fold."""
    if len(score.estimates) < 2:
        return np.full(len(entries), np.nan)
    return np.sqrt(np.diagonal(change_covariance(score.estimates[:, list(entries)])))


def _blocks(records: Sequence[FitRecord], whole_runs: bool) -> tuple[float, list[np.ndarray], int]:
    """Return the length of a block, the block number of each row, and the number of blocks."""
    if whole_runs:
        first_run = min(r.run for r in records)
        block_numbers = [np.full(len(r.dt_s), r.run - first_run) for r in records]
        return 0.0, block_numbers, max(r.run for r in records) + 1 - first_run
    total = sum(float(np.sum(r.dt_s)) for r in records)
    if total < MIN_BLOCKS * SHORT_BLOCK_S:
        raise UsageError.of("choose.short", total_s=total, min_s=MIN_BLOCKS * SHORT_BLOCK_S)
    block_s = max(min(max(total / MIN_BLOCK_COUNT, SHORT_BLOCK_S), BLOCK_S), total / MAX_BLOCKS)
    block_numbers, first_run = [], 0
    for record in records:
        ends = np.cumsum(record.dt_s)
        count = max(1, round(float(ends[-1]) / block_s))
        block_numbers.append(first_run + np.minimum((ends / ends[-1] * count).astype(int), count - 1))
        first_run += count
    return block_s, block_numbers, first_run


def _widen(is_held_out: np.ndarray, dt_s: np.ndarray) -> np.ndarray:
    """Return a mask (N,) of the rows `is_held_out` (N,) and of the rows within GAP_S of them."""
    ends = np.cumsum(dt_s)
    edges = np.flatnonzero(np.diff(is_held_out.astype(int)) != 0)
    is_excluded = is_held_out.copy()
    for k in edges:
        is_excluded |= np.abs(ends - ends[k]) < GAP_S
    return is_excluded


def independent_motion_count(runs: Sequence[Run], command: int) -> float:
    """Return the number of independent segments of motion of a command in all runs; 0 if it is always 0.  (4)"""
    u = [run.applied_commands[np.isfinite(run.applied_commands[:, command]), command] for run in runs]
    all_commands = np.concatenate([np.zeros(1), *u])
    min_change = MIN_CHANGE_RATIO * float(np.ptp(all_commands))
    piece_count = 0.0
    for run, x in zip(runs, u, strict=True):
        if np.any(x != 0.0):
            duration_s = run.duration_s * len(run.t_ns) / max(1, len(run.t_ns) - 1)  # with the first tick
            piece_count += min(1.0 + extremum_count(x, min_change), max(1.0, duration_s / SHORT_BLOCK_S))
    return piece_count


def extremum_count(x: np.ndarray, min_change: float) -> int:
    """Return the number of local extrema of x (N,) that differ by more than `min_change` from their neighbours."""
    count, direction, low, high = 0, 0, x[0], x[0]
    for value in x[np.flatnonzero(np.diff(x, prepend=np.nan) != 0.0)]:
        low, high = min(low, value), max(high, value)
        if direction >= 0 and high - value > min_change:
            count, direction, low, high = count + (direction > 0), -1, value, value
        elif direction <= 0 and value - low > min_change:
            count, direction, low, high = count + (direction < 0), 1, value, value
    return count
