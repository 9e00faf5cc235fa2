"""Compare the EKF over a run of ten minutes: one kernel against filterpy."""

from time import process_time

import numpy as np

from baqueano.estimators import Ekf
from baqueano.signals import Slot, Tick, sensor_slots
from baqueano.symbolic import scan
from benchmarks import paper, peers
from benchmarks.harness import Bench, Case, measured

R = np.diag([1e-6, 1e-6, 1e-8, 1e-4, 1e-4, 1e-6])


def benches(smallest: bool) -> list[Bench]:
    """Return the benches in the paper's mode, in which filterpy must find the same velocities, and the default mode."""
    duration_s = 2.0 if smallest else 600.0
    u, vehicle, sensors = paper.signal(duration_s), paper.vehicle(), paper.sensors()
    theta, m, I = peers.parameters()
    n = len(u)
    z = peers.measurements(u[:6000], theta, m, I)
    z = np.tile(z, (-(-n // 6000), 1))[:n] + np.random.default_rng(2).standard_normal((n, 3)) * [
        0.05,
        0.05,
        0.005,
    ]
    ticks = Tick(
        10_000_000 * np.arange(1, n + 1), u, sensor_slots(("imu",))(Slot(np.ones(n), z, np.zeros(n)))
    )
    tick = Tick(1, np.zeros(3), sensor_slots(("imu",))(Slot(1.0, np.zeros(3))))
    filters = {mode: Ekf(vehicle, sensors, R, mode=mode) for mode in ("paper", "default")}
    kernels = {mode: _kernel(ekf, tick) for mode, ekf in filters.items()}
    P0 = np.diag(filters["paper"].initial_std[3:] ** 2)

    def by_filterpy():
        return peers.filtered(u, z, theta, m, I, sensors.imu.cov, R, P0)

    np.testing.assert_allclose(kernels["paper"].run(ticks)[1][1], by_filterpy()[:, :3], atol=1e-8)
    cases = [
        Case("scan, paper mode, pose and its covariance too", lambda: kernels["paper"].run(ticks)),
        Case("scan, default mode", lambda: kernels["default"].run(ticks)),
        Case("filterpy, 6 states", by_filterpy, 1 if smallest else 3),
    ]
    title = f"EKF over {duration_s:g} s at 100 Hz"
    return [measured(title, cases, {"filterpy, 6 states": 200.0}, clock=process_time)]


def _kernel(ekf, tick):
    def step(belief, tick):
        belief, estimate = ekf.step(belief, tick)
        return belief, (estimate.eta, estimate.nu, estimate.cov)

    return scan(step, ekf.init(), tick)
