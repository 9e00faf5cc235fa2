"""Test the noise of a filter on held-out runs, and compare two noise matrices R.

    NIS_c = Σ_t y_c² / S_cc / N   over readings of channel c in the held-out runs, 1 if the noise is correct (1)
    NEES_s = Σ_t e_s² / P_ss / N  of state s over drives of the fitted vehicle with this noise               (2)
    NIS = mean of yᵀ S⁻¹ y / m,   L = −½ mean of (log |S| + yᵀ S⁻¹ y):   a higher L predicts better          (3)

y are the innovations of the filter with their covariance S, limited to ROBUST_SIGMA standard deviations. Innovations of
a real vehicle are not white, so the intervals of (1) and (3) come from blocks of BLOCK_S. A channel agrees if its
interval contains a value from 1/CLOSE_FACTOR to CLOSE_FACTOR. If a channel disagrees, the runs of the fit do not show
the noise of this vehicle: it is estimated again over all runs (filter_noise.py), and channels that still disagree are
reported. A state agrees within CLOSE_FACTOR_ON_DRIVES; each drive of (2) is one block (simulate/assumed_noise.py). NIS
is a weak test of R, because the measurement noise is most of S: L decides.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from baqueano.contracts.values import JsonObject, TableRow, Tree
from baqueano.diagnostics import Diagnostic, Severity, Verdict, fault, note
from baqueano.errors import UsageError
from baqueano.estimators import Ekf
from baqueano.estimators.augmented.state import layout
from baqueano.estimators.augmented_ekf import AugmentedEkf
from baqueano.identify.noise.filter_noise import ROBUST_SIGMA
from baqueano.identify.noise.process_noise import (
    ROBUST_SIGMA as COMPARED_SIGMA,
)
from baqueano.identify.noise.process_noise import (
    example_filter_tick,
    filter_of,
    terms_by_sensor,
    ticks_of,
)
from baqueano.identify.noise.speed_channels import ratio_of_blocks
from baqueano.messages.language import number
from baqueano.messages.language import translate as _
from baqueano.messages.text_table import text_table
from baqueano.numerics.statistics import QUANTILE_95
from baqueano.runs.run import Run
from baqueano.signals import Tick, seconds
from baqueano.simulate.assumed_noise import simulated_errors
from baqueano.symbolic import scan, with_value
from baqueano.symbolic.scan import Scan

if TYPE_CHECKING:
    from baqueano.identify.noise.covariances import Noise
    from baqueano.identify.result.fit_result import Fit

BLOCK_S = 2.0  # longer than innovations are correlated
CLOSE_FACTOR = 1.2  # factor on a variance: a smaller error does not degrade a filter
# factor on the variance of a state: larger, because consider scales and slips are partly nonlinear
CLOSE_FACTOR_ON_DRIVES = 1.5
STATES = ("x", "y", "heading", "v_x", "v_y", "yaw_rate")


class NoiseVerdict(StrEnum):
    """Verdict on the noise of a filter."""

    TRUE = "true"
    TOO_SURE = "too sure"
    TOO_CAREFUL = "too cautious"
    CANNOT_TELL = "cannot tell"


class NormalisedSquare(NamedTuple):
    """The NIS of a channel or the NEES of a state, with its 95 % interval."""

    name: str  # "imu[2]", "heading"
    mean: float
    low: float  # NaN with too few blocks
    high: float
    close_factor: float  # factor within which the mean agrees with 1

    @property
    def verdict(self) -> NoiseVerdict:
        """Return the verdict on the noise."""
        if not np.isfinite(self.low):
            return NoiseVerdict.CANNOT_TELL
        if self.low > self.close_factor:
            return NoiseVerdict.TOO_SURE
        return NoiseVerdict.TOO_CAREFUL if self.high < 1.0 / self.close_factor else NoiseVerdict.TRUE

    @property
    def disagrees(self) -> bool:
        """Return True if the filter is overconfident or conservative."""
        return self.verdict in (NoiseVerdict.TOO_SURE, NoiseVerdict.TOO_CAREFUL)


class Acceptance(NamedTuple):
    """Verdict of held-out runs on the noise that is written."""

    message: Diagnostic
    disagrees: bool  # True if the noise still disagrees after the new estimate, or on simulated drives


def accept_or_refit(
    ekf: AugmentedEkf,
    refit: Callable[[], AugmentedEkf],
    validation_runs: Sequence[Run],
    backend: str = "auto",
) -> tuple[AugmentedEkf, Acceptance]:
    """Return the filter whose noise is written, and the verdict. The filter is `ekf` if the `validation_runs` agree
    with it or are too short for a test, else `refit()`, with the noise over all runs."""
    runs, kernel = ", ".join(run.name for run in validation_runs), _filter_scan(ekf, backend)
    squares = nis_of(ekf, validation_runs, kernel)
    decisive = [square for square in squares if square.verdict != NoiseVerdict.CANNOT_TELL]
    if not decisive:
        return ekf, Acceptance(note("noise.too-short", runs=runs), False)
    disagreeing, code = [square for square in decisive if square.disagrees], "noise.holds"
    figures: JsonObject = {"runs": runs, "nis": _figures(decisive)}
    if disagreeing:
        ekf, code = refit(), "noise.found-again"
        kernel, names = _filter_scan(ekf, backend), {square.name for square in disagreeing}
        squares = nis_of(ekf, validation_runs, kernel)
        again = [square for square in squares if square.name in names or square.disagrees]
        figures |= {"nis": _figures(disagreeing), "again": _figures(again)}
        if remaining := [square for square in again if square.disagrees]:
            figures |= _by_consistency(remaining)
            return ekf, Acceptance(note("noise.still-off", Severity.WARNING, **figures), True)
    nees = nees_of(ekf, validation_runs[0], kernel)
    if disagreeing_states := [square for square in nees if square.disagrees]:
        figures = {"nees": _figures(nees), **_by_consistency(disagreeing_states)}
        return ekf, Acceptance(note("noise.nees-off", Severity.WARNING, **figures), True)
    if nees and not disagreeing:
        code, figures = "noise.holds-simulated", figures | {"nees": _figures(nees)}
    return ekf, Acceptance(note(code, **figures), False)


def nis_of(ekf: AugmentedEkf, runs: Sequence[Run], kernel: Scan) -> list[NormalisedSquare]:
    """Return the NIS of each channel that corrects the motion, in the order of the layout.  (1)"""
    filter_layout = layout(ekf)
    names = [f"{name}[{i}]" for name, i in filter_layout.channel_entries]
    squares, counts = [], []
    for run in runs:
        ticks = ticks_of(run, ekf, len(run.t_ns))
        square = np.asarray(kernel.run(ticks)[1][0])
        is_present = np.isfinite(square)
        block = (seconds(ticks.t_ns, int(ticks.t_ns[0])) // BLOCK_S).astype(int)
        square = np.minimum(np.where(is_present, square, 0.0), ROBUST_SIGMA**2)
        squares.append(np.stack([np.bincount(block, column) for column in square.T], axis=1))
        counts.append(np.stack([np.bincount(block, column) for column in is_present.T], axis=1))
    square, count = np.concatenate(squares), np.concatenate(counts)
    return [
        _normalised_square(names[k], square[:, k], count[:, k], CLOSE_FACTOR)
        for k in np.flatnonzero(np.any(filter_layout.moving_mask > 0.0, axis=1))
    ]


def nees_of(ekf: AugmentedEkf, run: Run, kernel: Scan) -> list[NormalisedSquare]:
    """Return the NEES of each state on drives like `run`, or an empty list if they cannot be simulated.  (2)"""
    e, P = simulated_errors(ekf, run, kernel)
    square = e**2 / np.diagonal(P, axis1=2, axis2=3)
    count = np.full(len(square), float(square.shape[1]))
    return [
        _normalised_square(name, square[:, :, k].sum(axis=1), count, CLOSE_FACTOR_ON_DRIVES)
        for k, name in enumerate(STATES if len(square) else ())
    ]


def _filter_scan(ekf: AugmentedEkf, backend: str) -> Scan:
    """Return a scan of the filter whose outputs are y²/S (m,), η, ν and the covariance."""

    def step(belief: Tree, tick: Tick) -> tuple[Tree, Any]:
        belief, estimate = ekf.row(belief, tick)
        y, S = estimate.innovation, estimate.innovation_cov
        assert y is not None
        assert S is not None
        return belief, (y**2 / np.diagonal(S), estimate.eta, estimate.nu, estimate.cov)

    return scan(step, ekf.init(), example_filter_tick(ekf), backend=backend)


def _normalised_square(
    name: str, square: np.ndarray, count: np.ndarray, close_factor: float
) -> NormalisedSquare:
    has, (mean, low, high) = count > 0.0, (float("nan"),) * 3
    if has.any():
        mean, low, high = ratio_of_blocks(square[has], count[has])
    return NormalisedSquare(name, mean**2, low**2, high**2, close_factor)


def _by_consistency(squares: Sequence[NormalisedSquare]) -> JsonObject:
    """Return the channels or states for which the filter is overconfident, and those for which it is conservative."""
    overconfident, cautious = (
        [square.name for square in squares if square.verdict == belief]
        for belief in (NoiseVerdict.TOO_SURE, NoiseVerdict.TOO_CAREFUL)
    )
    return {"too_sure": overconfident, "too_careful": cautious}


def _figures(noise: Sequence[NormalisedSquare]) -> str:
    return ", ".join(
        f"{square.name}: {square.mean:.2f} ({square.low:.2f} … {square.high:.2f})" for square in noise
    )


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
        """Return the name of the noise matrix R with the largest L.  (3)"""
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
        on = _("on {runs}", runs=", ".join(self.runs))
        head = [_("R from"), "NIS", "95 %", _("log-likelihood"), on]
        rows = (
            [trial.name, f"{number(trial.nis):.3f}", _("{low:.2f} to {high:.2f}", low=trial.low, high=trial.high),
             f"{number(trial.likelihood):.4f}", _(trial.consistent)]
            for trial in self.trials
        )  # fmt: skip
        lines = text_table("<>>><", head, *rows)
        return "\n".join([*lines, _("best: {name}", name=self.best)])


def compare_noise(
    fit: "Fit", noises: Mapping[str, "Noise"], held_out: Run | Sequence[Run], backend: str = "auto"
) -> NoiseComparison:
    """Return the results of `noises` (name → Q and R) in the filter of the fitted file, on runs that the fit did not
    use.  (3)

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
        raise UsageError(fault("noise.nothing-to-compare"))
    runs_of_fit = [run.name for run in runs if fit.includes(run)]
    if runs_of_fit:
        raise UsageError(fault("noise.fitted-to", run=runs_of_fit[0]))
    if fit.file.kind("estimator") is not Ekf:
        raise UsageError(fault("noise.not-ekf", vehicle=fit.file.name))
    ekf = filter_of(fit, _sensor_covariances(fit, next(iter(noises.values()))))
    size = 36 + sum(getattr(ekf.sensors, name).size ** 2 for name in ekf.use)  # entries of R and of each Q
    kernel = scan(_innovations(ekf), ekf.init(), example_filter_tick(ekf), np.zeros(size), backend=backend)
    max_ticks = TICKS.get(kernel.backend, 500) // len(runs)
    ticks = [ticks_of(run, ekf, max_ticks) for run in runs]
    per_block = max(1, round(BLOCK_S * fit.file.rate_hz))
    trials = []
    for name, noise in noises.items():
        q = _sensor_covariances(fit, noise)
        theta = np.concatenate([noise.process.ravel(), *(q[sensor].ravel() for sensor in ekf.use)])
        logs = [np.asarray(kernel.run(of_run, theta)[1]) for of_run in ticks]
        trials.append(_trial(name, logs, per_block))
    trials.sort(key=lambda trial: -trial.likelihood)
    return NoiseComparison(tuple(trials), tuple(run.name for run in runs))


def _sensor_covariances(fit: "Fit", noise: "Noise") -> dict[str, np.ndarray]:
    """Return Q of the sensors that are in the file."""
    return {name: q for name, q in noise.in_motion.items() if name in fit.file.sensors._fields}


def _trial(name: str, logs: list[np.ndarray], per_block: int) -> NoiseTrial:
    """Return the result for one R from (square, log |S|, count) per tick (N, 3) of each run."""
    square, log_det, count = np.concatenate(logs).T
    blocks = []
    for run_logs in logs:
        rows = len(run_logs) // per_block * per_block
        blocks.append(run_logs[:rows, [0, 2]].reshape(-1, per_block, 2).sum(axis=1))
    measured = max(1.0, float(count.sum()))
    nis = float(square.sum() / measured)
    total, weight = np.concatenate(blocks).T
    std = float(np.sqrt(np.sum((total - nis * weight) ** 2)) / max(1.0, float(weight.sum())))
    likelihood = float(-0.5 * np.sum(log_det + square) / measured)
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
        for has, sensor_log_det, sensor_square, m in terms_by_sensor(ekf, tick, estimate):
            square = square + np.where(has, np.minimum(sensor_square, COMPARED_SIGMA**2 * m), 0.0)
            log_det = log_det + np.where(has, sensor_log_det, 0.0)
            count = count + np.where(has, float(m), 0.0)
        return belief, np.array([square, log_det, count])

    return step
