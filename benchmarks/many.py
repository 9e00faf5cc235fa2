"""Simulate ten thousand vehicles, 60 s each, with different parameters: one batch against vectorised NumPy."""

from types import SimpleNamespace

import numpy as np

from baqueano.simulate import simulate_many
from benchmarks import paper, peers
from benchmarks.harness import Bench, Case, measured

PATHS = ("model.friction.linear", "model.friction.quadratic", "model.actuator_matrix")


def benches(smallest: bool) -> list[Bench]:
    """Return the benches against NumPy, on all processors and on one, because NumPy uses only one."""
    vehicles, duration_s = (40, 2.0) if smallest else (10_000, 60.0)
    theta, m, I = peers.parameters()
    thetas = theta * np.random.default_rng(1).uniform(0.8, 1.2, (vehicles, 15))
    u = paper.signal(duration_s)
    file = SimpleNamespace(
        envelope=None,
        vehicle=paper.vehicle(), sensors=paper.sensors(), rate_hz=100.0,
        command=SimpleNamespace(names=("u_x", "u_y", "u_psi"), limit=np.array([20.0, 0.0, 60.0])),
    )  # fmt: skip
    vary = {PATHS[0]: thetas[:, :3], PATHS[1]: thetas[:, 3:6], PATHS[2]: thetas[:, 6:].reshape(-1, 3, 3)}
    first_values = {path: values[:40] for path, values in vary.items()}
    np.testing.assert_allclose(
        simulate_many(file, u, vary=first_values).nu[:, 0],
        peers.simulate_many(u, thetas[:40], m, I)[:, 3:],
        atol=1e-8,
    )
    cases = [
        Case("simulate_many()", lambda: simulate_many(file, u, vary=vary), 3),
        Case("NumPy, vectorised", lambda: peers.simulate_many(u, thetas, m, I), 1),
    ]
    return [
        measured(f"{vehicles:,} vehicles, {duration_s:g} s at 100 Hz", cases, {"NumPy, vectorised": 15.0})
    ]
