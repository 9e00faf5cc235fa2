"""Simulate 60 s at 100 Hz: one kernel against a NumPy loop, and against the same blocks without a compiler."""

from time import process_time
from types import SimpleNamespace

import numpy as np

from baqueano.simulate import simulate
from baqueano.symbolic import scan
from benchmarks import paper, peers
from benchmarks.harness import Bench, Case, measured


def benches(smallest: bool) -> list[Bench]:
    """Return the benches of the vehicle alone, and of a run with process noise and an IMU."""
    u = paper.signal(2.0 if smallest else 60.0)
    return [vehicle_alone(u), whole_run(u)]


def vehicle_alone(u: np.ndarray) -> Bench:
    """Return the bench of the trajectory of the paper's model, with every tick as output."""
    vehicle = paper.vehicle()
    zero = np.zeros(3)

    def step(state, uk):
        state, motion = vehicle.step(state, uk, peers.DT, zero)
        return state, (motion.eta, motion.nu)

    kernels = {name: scan(step, vehicle.init(), u[0], backend=name) for name in ("auto", "python")}
    theta, m, I = peers.parameters()
    eta, nu = kernels["auto"].run(u)[1]
    reference = peers.simulate(u, theta, m, I)
    np.testing.assert_allclose(nu, reference[:, 3:], atol=1e-9)
    np.testing.assert_allclose(eta[:, :2], reference[:, :2], atol=1e-8)
    cases = [
        Case(f"scan, {kernels['auto'].backend}", lambda: kernels["auto"].run(u)),
        Case("scan, Python code (no compiler)", lambda: kernels["python"].run(u)),
        Case("NumPy loop", lambda: peers.simulate(u, theta, m, I), 3),
    ]
    title = f"simulation, {len(u) / 100:g} s at 100 Hz, the paper's vehicle"
    return measured(title, cases, {"NumPy loop": 300.0}, clock=process_time)


def whole_run(u: np.ndarray) -> Bench:
    """Return the bench of simulate() with process noise and an IMU, including the draw of the noise and the Run."""
    vehicle = paper.vehicle()
    file = SimpleNamespace(
        envelope=None,
        vehicle=vehicle, sensors=paper.sensors(), rate_hz=100.0, text="",
        command=SimpleNamespace(names=("u_x", "u_y", "u_psi"), limit=np.array([20.0, 0.0, 60.0])),
    )  # fmt: skip
    cases = [
        Case("simulate()", lambda: simulate(file, u)),
        Case("the same blocks in NumPy", lambda: simulate(file, u, backend="numpy"), 1),
    ]
    return measured(
        f"simulation with noise and IMU, {len(u) / 100:g} s at 100 Hz, as a run",
        cases,
        {},
        clock=process_time,
    )
