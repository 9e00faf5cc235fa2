"""Estimate R of a filter by maximum likelihood of its innovations, or from the truth of a simulation.

    J(R) = Σ_t ½ (log |S_t| + ρ(y_tᵀ S_t⁻¹ y_t)),   R = diag(exp 2q)                                      (1)
    ρ(d²) = d² up to K² m, beyond it 2 K √m d − K² m, K = ROBUST_SIGMA: limits the effect of an outlier   (2)

y and S come from the extended Kalman filter while it runs over the log. So R is correct for that filter, with its
mode, gate and rate. With the truth of a simulation, R is the covariance of the prediction error of one step of the
filter, μ_t − g(u_t, μ_{t−1}), μ = (ν, ν̇), g of ekf.py.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from baqueano.contracts import optional
from baqueano.contracts.values import Tree
from baqueano.estimators import Ekf
from baqueano.identify.data.record import make_record
from baqueano.identify.residuals.motion import motion_rows, open_loop
from baqueano.numerics.gaussian_likelihood import log_det_and_square, robust_square
from baqueano.numerics.quasi_newton import minimise_logarithms
from baqueano.runs.filter_ticks import example_filter_tick, make_ticks
from baqueano.runs.run import Run
from baqueano.signals import Estimate, Tick, seconds
from baqueano.symbolic import scan, with_value
from baqueano.symbolic.scan import Scan
from baqueano.vehicles.state import tick_effort

if TYPE_CHECKING:
    from baqueano.identify.result.fit_result import Fit

ROBUST_SIGMA = 3.0  # standard deviations
TICKS = {"c": 12_000, "python": 600, "numpy": 200}  # ticks that are used, by backend
MIN_RELATIVE_STD = 1e-4  # least standard deviation, relative to the root mean square of the state


def process_covariance(
    fit: "Fit", runs: Sequence[Run], measurement: dict[str, np.ndarray], backend: str
) -> tuple[np.ndarray, np.ndarray]:
    """Return the diagonal R (6, 6) for the given Q of each sensor, and the root mean square (6,) of (ν, ν̇)."""
    ekf = fitted_filter(fit, measurement)
    kernel = scan(_likelihood(ekf), ekf.init(), example_filter_tick(ekf), np.zeros(6), backend=backend)
    max_ticks = TICKS.get(kernel.backend, 600) // len(runs)
    ticks = [make_ticks(run, ekf, max_ticks) for run in runs]
    size = np.max([_motion_rms(fit, run) for run in runs], axis=0)
    low, high = np.log(MIN_RELATIVE_STD * size), np.log(size)

    q = minimise_logarithms(total_cost(kernel, ticks), np.clip(np.log(0.03 * size), low, high), low, high)
    return np.diag(np.exp(2.0 * q)), size


def total_cost(kernel: Scan, ticks: Sequence[Any]) -> Callable[[np.ndarray], float]:
    """Return the function q → cost of a scan over the ticks of all runs, inf for a filter that diverges."""

    def cost(q: np.ndarray) -> float:
        total = sum(float(kernel.cost(run_ticks, q)) for run_ticks in ticks)
        return total if np.isfinite(total) else np.inf

    return cost


def fitted_filter(fit: "Fit", measurement: dict[str, np.ndarray]) -> Ekf:
    """Return the filter of the file, or an `Ekf` for other kinds, with the fitted vehicle and the measured Q."""
    sensors = fit.file.sensors
    for name, q in measurement.items():
        block = getattr(fit.blocks.sensors, name, getattr(sensors, name))
        sensors = sensors._replace(**{name: replace(block, measurement_noise_cov=q)})
    estimator = fit.file.estimator(process_noise_cov=np.eye(6))
    has_stacks = optional.attribute(estimator, "stacks_innovations")
    use = tuple(n for n in (estimator.use if has_stacks else measurement) if n in measurement)
    use = use or tuple(measurement)
    if has_stacks:
        return replace(estimator, vehicle=fit.blocks.model, sensors=sensors, use=use)
    return Ekf(fit.blocks.model, sensors, np.eye(6), fit.file.rate_hz, use=use)


def sensor_terms(ekf: Ekf, estimate: Estimate) -> Iterator[tuple[Tree, Tree, Tree]]:
    """Yield for each sensor log |S| and yᵀ S⁻¹ y of its measured channels, and their number; 0 without any."""
    innovation, cov, offset = estimate.innovation, estimate.innovation_cov, 0
    assert innovation is not None
    assert cov is not None
    for name in ekf.use:
        span = slice(offset, offset + getattr(ekf.sensors, name).size)
        mask = np.where(np.isfinite(innovation[span]), 1.0, 0.0)
        yield *log_det_and_square(cov[span, span], innovation[span], mask), np.sum(mask)
        offset = span.stop


def _likelihood(ekf: Ekf) -> Callable[..., Tree]:
    def step(q: np.ndarray, belief: Tree, tick: Tick) -> tuple[Tree, Tree]:
        belief, estimate = with_value(ekf, "process_noise_cov", np.diag(np.exp(2.0 * q))).row(belief, tick)
        total = 0.0
        for log_det, square, count in sensor_terms(ekf, estimate):
            rho = robust_square(square, ROBUST_SIGMA * np.sqrt(np.maximum(count, 1.0)))
            total = total + np.where(count > 0.0, 0.5 * (log_det + rho), 0.0)
        return belief, total

    return step


def _motion_rms(fit: "Fit", run: Run) -> np.ndarray:
    """Return the root mean square (6,) of (ν, ν̇) of the model under the run's commands."""
    kernel, theta = open_loop(fit.blocks.model, (), lambda motion: np.concatenate([motion.nu, motion.nu_dot]))
    _, mu = kernel.run(motion_rows(make_record(run, {})), theta)
    return np.maximum(np.sqrt(np.mean(np.asarray(mu) ** 2, axis=0)), 1e-6)


class PredictionState(NamedTuple):
    """State of the prediction."""

    drivetrain: Tree
    effort: np.ndarray  # (n,) at the end of the previous step


def process_errors(fit: "Fit", runs: Sequence[Run], backend: str) -> tuple[np.ndarray, np.ndarray]:
    """Return errors (N, 6) of the filter's prediction of (ν, ν̇) over a tick, and the rms (6,) of (ν, ν̇)."""
    ekf = fitted_filter(fit, {})
    drivetrain, n = ekf.vehicle.drivetrain, ekf.vehicle.commands

    def step(previous: PredictionState, row: np.ndarray) -> tuple[PredictionState, np.ndarray]:
        mu, u = row[1 + n :], row[1 : 1 + n]
        state, effort = tick_effort(ekf.vehicle, previous.drivetrain, mu[2], mu[3:6], u, row[0])
        mu = ekf.advance_mean(mu, previous.effort, effort, row[0])
        return PredictionState(state, effort.last), mu[3:]

    kernel = scan(step, PredictionState(drivetrain.init(), np.zeros(n)), np.zeros(10 + n), backend=backend)
    errors, states = [], []
    for run in runs:
        rows, mu = _rows(run)
        errors.append((mu[1:] - kernel.run(rows)[1])[2:])  # the first rows do not have a previous effort
        states.append(mu)
    return np.concatenate(errors), np.sqrt(np.mean(np.concatenate(states) ** 2, axis=0))


def _rows(run: Run) -> tuple[np.ndarray, np.ndarray]:
    """Return rows (N, q) of (dt, u, previous η, ν, ν̇), and μ (N + 1, 6), over ticks with a truth."""
    truth = run.truth
    assert truth is not None
    _, ticks, rows = np.intersect1d(run.t_ns, truth.t_ns, return_indices=True)
    mu = np.concatenate([truth.nu[rows], truth.nu_dot[rows]], axis=1)
    t_ns, u = run.t_ns[ticks], run.applied_commands[ticks]
    dt_s = seconds(t_ns[1:], t_ns[:-1])
    columns = [dt_s[:, None], u[1:], truth.eta[rows][:-1], mu[:-1]]
    return np.ascontiguousarray(np.concatenate(columns, axis=1)), mu
