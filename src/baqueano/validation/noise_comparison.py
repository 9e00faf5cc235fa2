"""Compare noise matrices R of a filter on data that were not used to estimate them.

    NIS = mean of yᵀ S⁻¹ y / m,   1 if the filter states its error correctly                              (1)
    L   = −½ mean of (log |S| + yᵀ S⁻¹ y),   a higher L means a better prediction of the filter          (2)

y are the innovations of the filter with their covariance S over a validation run. Innovations are limited to
ROBUST_SIGMA standard deviations. The interval of (1) is from means over blocks of BLOCK_S. The innovations of a real
vehicle are not white, and χ² bands are too narrow for them. NIS is a weak test, because the measurement noise is most
of S: (2) decides.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from baqueano.contracts.values import TableRow, Tree
from baqueano.diagnostics import Verdict
from baqueano.errors import UsageError
from baqueano.estimators import Ekf
from baqueano.identify.noise.covariances import Noise
from baqueano.identify.noise.process_noise import ROBUST_SIGMA, fitted_filter, sensor_terms
from baqueano.identify.result.fit_result import Fit
from baqueano.messages.language import number, translate as _
from baqueano.messages.text_table import text_table
from baqueano.numerics.statistics import QUANTILE_95
from baqueano.runs.filter_ticks import example_filter_tick, make_ticks
from baqueano.runs.run import Run
from baqueano.signals import Tick
from baqueano.symbolic import scan, with_value

BLOCK_S = 2.0
TICKS = {"c": 60_000, "python": 2000, "numpy": 500}


class NoiseTrial(NamedTuple):
    """Result of one noise matrix R on the held-out runs."""

    name: str
    nis: float
    low: float  # 95 % interval of the NIS
    high: float
    likelihood: float  # L

    @property
    def consistent(self) -> str:
        """Return the verdict of the NIS: "too sure", "too cautious" or "consistent"."""
        if self.low > 1.0:
            return "too sure"
        return "too cautious" if self.high < 1.0 else "consistent"


@dataclass(frozen=True, slots=True, eq=False)
class NoiseComparison:
    """Results of all noise matrices R, the best first."""

    trials: tuple[NoiseTrial, ...]
    runs: tuple[str, ...]

    @property
    def best(self) -> str:
        """Return the name of the noise matrix R with the largest L.  (2)"""
        return self.trials[0].name

    @property
    def verdict(self) -> Verdict:
        """Return USABLE if the best R is consistent, else WARN."""
        return Verdict.USABLE if self.trials[0].consistent == "consistent" else Verdict.WARN

    def rows(self) -> list[TableRow]:
        """Return one flat row per noise matrix R."""
        return [trial._asdict() | {"consistent": trial.consistent} for trial in self.trials]

    def table(self) -> str:
        """Return the table as text."""
        run_names = _("on {runs}", runs=", ".join(self.runs))
        head = [_("R from"), "NIS", "95 %", _("log-likelihood"), run_names]
        rows = (
            [trial.name, f"{number(trial.nis):.3f}", _("{low:.2f} to {high:.2f}", low=trial.low, high=trial.high),
             f"{number(trial.likelihood):.4f}", _(trial.consistent)]
            for trial in self.trials
        )  # fmt: skip
        lines = text_table("<>>><", head, *rows)
        return "\n".join([*lines, _("best: {name}", name=self.best)])


def compare_noise(
    fit: Fit, noises: Mapping[str, Noise], held_out: Run | Sequence[Run], backend: str = "auto"
) -> NoiseComparison:
    """Return the results of `noises` (name → Q and R) in the filter of the fitted file, on runs that the fit did not
    use.  (1), (2)

    Raise UsageError without a noise or a run, for a run of `fit`, or if the estimator of the file is not an `Ekf`.

    >>> from dataclasses import replace
    >>> from baqueano.identify import identify, measure_noise, random_steps
    >>> from baqueano.simulate import simulate
    >>> from baqueano.vehicle_file import load
    >>> u = [random_steps((paper := load("case-study-1")).command.limit, 10.0, 100.0, seed) for seed in (1, 2)]
    >>> first, second = (simulate(paper, one, k, name=f"run {k}") for k, one in enumerate(u))
    >>> noise = measure_noise(fit := identify(first, paper, ["model.mass_kg"]), first)
    >>> print(compare_noise(fit, {"R": noise, "100 R": replace(noise, process=100 * noise.process)}, second).best)
    R
    """
    runs = [held_out] if isinstance(held_out, Run) else list(held_out)
    if not noises or not runs:
        raise UsageError.of("noise.nothing-to-compare")
    fit_runs = [run.name for run in runs if fit.includes(run)]
    if fit_runs:
        raise UsageError.of("noise.fitted-to", run=fit_runs[0])
    if fit.file.kind("estimator") is not Ekf:
        raise UsageError.of("noise.not-ekf", vehicle=fit.file.name)
    ekf = fitted_filter(fit, _sensor_covariances(fit, next(iter(noises.values()))))
    size = 36 + sum(getattr(ekf.sensors, name).size ** 2 for name in ekf.use)  # entries of R and of each Q
    kernel = scan(_innovations(ekf), ekf.init(), example_filter_tick(ekf), np.zeros(size), backend=backend)
    max_ticks = TICKS.get(kernel.backend, 500) // len(runs)
    ticks = [make_ticks(run, ekf, max_ticks) for run in runs]
    per_block = max(1, round(BLOCK_S * fit.file.rate_hz))
    trials = []
    for name, noise in noises.items():
        q = _sensor_covariances(fit, noise)
        theta = np.concatenate([noise.process.ravel(), *(q[sensor].ravel() for sensor in ekf.use)])
        logs = [np.asarray(kernel.run(run_ticks, theta)[1]) for run_ticks in ticks]
        trials.append(_trial(name, logs, per_block))
    trials.sort(key=lambda trial: -trial.likelihood)
    return NoiseComparison(tuple(trials), tuple(run.name for run in runs))


def _sensor_covariances(fit: Fit, noise: Noise) -> dict[str, np.ndarray]:
    """Return Q of the sensors that are in the file."""
    return {name: q for name, q in noise.in_motion.items() if name in fit.file.sensors._fields}


def _trial(name: str, logs: list[np.ndarray], per_block: int) -> NoiseTrial:
    """Return the result for one R from (square, log |S|, count) per tick (N, 3) of each run."""
    square, log_det, count = np.concatenate(logs).T
    blocks = []
    for run_logs in logs:
        rows = len(run_logs) // per_block * per_block
        blocks.append(run_logs[:rows, [0, 2]].reshape(-1, per_block, 2).sum(axis=1))
    entry_count = max(1.0, float(count.sum()))
    nis = float(square.sum() / entry_count)
    total, weight = np.concatenate(blocks).T
    std = float(np.sqrt(np.sum((total - nis * weight) ** 2)) / max(1.0, float(weight.sum())))
    likelihood = float(-0.5 * np.sum(log_det + square) / entry_count)
    return NoiseTrial(name, nis, nis - QUANTILE_95 * std, nis + QUANTILE_95 * std, likelihood)


def _innovations(ekf: Ekf) -> Callable[..., Tree]:
    """Return the step of a scan with R and Q as parameters. Its outputs (3,) per tick are yᵀ S⁻¹ y, log |S| and the
    number of measured entries."""
    sizes = [getattr(ekf.sensors, name).size for name in ekf.use]

    def step(theta: np.ndarray, belief: Tree, tick: Tick) -> tuple[Tree, np.ndarray]:
        trial_filter, offset = with_value(ekf, "process_noise_cov", theta[:36].reshape(6, 6)), 36
        for name, m in zip(ekf.use, sizes, strict=True):
            q = theta[offset : offset + m * m].reshape(m, m)
            trial_filter = with_value(trial_filter, f"sensors.{name}.measurement_noise_cov", q)
            offset = offset + m * m
        belief, estimate = trial_filter.row(belief, tick)
        square, log_det, count = 0.0, 0.0, 0.0
        for sensor_log_det, sensor_square, m in sensor_terms(ekf, estimate):
            square = square + np.minimum(sensor_square, ROBUST_SIGMA**2 * m)
            log_det, count = log_det + sensor_log_det, count + m
        return belief, np.array([square, log_det, count])

    return step
