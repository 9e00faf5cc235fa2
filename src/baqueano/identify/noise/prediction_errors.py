"""What a model's step misses: μ_t − g(u_t, μ_{t−1}) against the truth of a simulation, μ = (ν, ν̇).

    g in mode "default":  a_d = ν̇ − f(ν, e₋),  ν̄ = ν ⊕ f(·, e) δ + a_d δ,  ν̇̄ = f(ν̄, e) + e^(−δ/T_d) a_d  (1)
    g in mode "paper":    ν̄ = ν + ν̇ δ,  ν̇̄ = f(ν, e)                                                     (2)
    g of a kinematic one: ν̄ = V e,  ν̇̄ = (V e − ν)/δ                                                      (3)

The same g as the filter's (estimators/ekf.py), because its errors are what R stands for there.
"""

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from baqueano.contracts.optional import is_dynamic
from baqueano.contracts.values import Tree, Value
from baqueano.runs.run import Run
from baqueano.signals import seconds
from baqueano.symbolic import scan
from baqueano.vehicles import Effort

if TYPE_CHECKING:
    from baqueano.identify.result.fit_result import Fit

FLOOR = 1e-4  # of the root mean square of a state: no deviation is believed to be smaller


class Before(NamedTuple):
    """What the prediction carries."""

    drivetrain: Tree
    effort: np.ndarray  # (n,) at the end of the step before


def process_errors(fit: "Fit", runs: Sequence[Run], backend: str = "auto") -> tuple[np.ndarray, np.ndarray]:
    """(N, 6) errors of the prediction of (ν, ν̇) over a tick, and the size (6,) of (ν, ν̇)."""
    mode, fading_s = prediction_of(fit)
    vehicle = fit.blocks.model
    n = vehicle.commands

    def step(before: Before, row: np.ndarray) -> tuple[Before, np.ndarray]:
        dt_s, u, eta, nu, nu_dot = (
            row[0],
            row[1 : 1 + n],
            row[1 + n : 4 + n],
            row[4 + n : 7 + n],
            row[7 + n : 10 + n],
        )
        drivetrain, effort = vehicle.drivetrain.step(before.drivetrain, u, dt_s)
        g = predicted(vehicle, mode, fading_s, eta, nu, nu_dot, before.effort, effort, dt_s)
        return Before(drivetrain, effort.last), g

    kernel = scan(step, Before(vehicle.drivetrain.init(), np.zeros(n)), np.zeros(10 + n), backend=backend)
    errors, states = [], []
    for run in runs:
        rows, mu = _rows(run)
        g = np.asarray(kernel.run(rows)[1])
        errors.append((mu[1:] - g)[2:])  # the first ones have no effort before them
        states.append(mu)
    return np.concatenate(errors), np.sqrt(np.mean(np.concatenate(states) ** 2, axis=0))


def predicted(
    vehicle: Tree,
    mode: str,
    fading_s: float,
    eta: np.ndarray,
    nu: np.ndarray,
    nu_dot: np.ndarray,
    before: np.ndarray,
    effort: Effort,
    dt_s: Value,
) -> np.ndarray:
    """g: (ν̄, ν̇̄) (6,).  (1)-(3)"""
    if not is_dynamic(vehicle):
        _, ahead, ahead_dot = vehicle.advance(eta, nu, effort, dt_s)
        return np.concatenate([ahead, ahead_dot])
    if mode == "paper":
        return np.concatenate([nu + nu_dot * dt_s, vehicle.nu_dot(nu, effort.last, eta[2])])
    unexplained = nu_dot - vehicle.nu_dot(nu, before, eta[2])
    turned, ahead, _ = vehicle.advance(eta, nu, effort, dt_s)
    ahead = ahead + unexplained * dt_s
    faded = np.exp(-dt_s / fading_s) * unexplained
    return np.concatenate([ahead, vehicle.nu_dot(ahead, effort.last, turned[2]) + faded])


def prediction_of(fit: "Fit") -> tuple[str, float]:
    """Mode of the file's estimator, and the time over which an unexplained acceleration fades in it."""
    estimator = fit.file.estimator(process_noise_cov=np.eye(6))
    return getattr(estimator, "mode", "default"), float(getattr(estimator, "disturbance_time_s", 0.5))


def _rows(run: Run) -> tuple[np.ndarray, np.ndarray]:
    """(N, q) rows (dt, u, η, ν, ν̇ of the tick before) and μ (N + 1, 6), over ticks that have a truth."""
    truth = run.truth
    assert truth is not None
    _, ticks, there = np.intersect1d(run.t_ns, truth.t_ns, return_indices=True)
    mu = np.concatenate([truth.nu[there], truth.nu_dot[there]], axis=1)
    t_ns, u = run.t_ns[ticks], run.applied[ticks]
    dt_s = seconds(t_ns[1:], t_ns[:-1])
    columns = [dt_s[:, None], u[1:], truth.eta[there][:-1], mu[:-1]]
    return np.ascontiguousarray(np.concatenate(columns, axis=1)), mu
