"""Every sensor of the package with every estimator that accepts any sensor."""

from functools import cache

import numpy as np
import pytest

from baqueano.compare.errors import wrap
from baqueano.geometry import compose, map_from_body
from baqueano.runs.filter_ticks import make_ticks
from baqueano.simulate import simulate
from baqueano.symbolic import scan
from baqueano.vehicle_file import load, parse

SENSORS = {
    "tags": "points_m = [[0.3, 0.0], [0.55, 0.05]]\nradius_m = 0.3",
    "beacon": "point_m = [3.0, 0.5]\nnoise_std = 0.02",
    "rangefinder": "wall_point_m = [3.0, 0.0]\nwall_heading_rad = 0.0\nincidence_rad = 1.2",
    "compass": "noise_std = 0.05",
    "encoders": "count_m = 0.001",
    "wheels": "noise_std = 0.01",
    "odometer": "noise_std = 0.01",
    "pose": "noise_std = [0.01, 0.01, 0.02]",
    "mark": "point_m = [0.3, 0.0]",
}
KINDS = ("augmented_ekf", "ekf", "dead_reckoning")
R = np.diag([1e-6, 1e-6, 1e-5, 1e-4, 1e-4, 1e-2])
USE = {"use": ("imu", "odometer")}
NOISY = USE | {"process_noise_cov": R}


@cache
def drive_with(kind: str):
    """Return a vehicle file with this sensor, and a drive of 4 s."""
    file = parse(f"{load('small').text}\n[sensors.{kind}]\n{SENSORS[kind]}\n", "small")
    u = np.zeros((400, 3))
    u[50:, 0], u[50:, 2] = 0.6, 0.03 * np.sin(np.arange(350) / 60.0)
    return file, simulate(file, u, 3)


@cache
def drive_of(kind: str, estimator: str, use):
    """Return a drive with this sensor, and what the estimator computes from the sensors in `use`."""
    file, run = drive_with(kind)
    options = {"process_noise_cov": R} if estimator != "augmented_ekf" else {}
    block = file.estimator(estimator, use=use, **options)
    ticks = make_ticks(run, block, len(run.t_ns))
    first = type(ticks)(*(leaf if leaf is None else _first(leaf) for leaf in ticks))
    return run, scan(block.row, block.init(), first).run(ticks)[1]


def _first(leaf):
    if hasattr(leaf, "_fields"):
        return type(leaf)(*(_first(x) for x in leaf))
    return leaf[0]


@pytest.mark.parametrize(
    ("kind", "estimator"),
    [(k, e) for k in SENSORS for e in KINDS] + [("tags", "unscented"), ("compass", "unscented")],
)
def test_an_estimate_is_finite_and_its_error_matches_its_covariance(kind, estimator):
    run, estimate = drive_of(kind, estimator, ("imu", kind))
    assert len(run.sensors[kind].z) > 0
    cov = estimate.cov
    assert np.all(np.isfinite(estimate.eta))
    assert np.all(np.linalg.eigvalsh(cov[1:]) > -1e-12)
    error = estimate.eta[-1] - run.truth.eta[-1]
    error[2] = wrap(error[2])
    assert np.all(np.abs(error) < 5.0 * np.sqrt(np.diag(cov[-1])[:3]) + 0.02)


@pytest.mark.parametrize("kind", ["tags", "beacon", "rangefinder", "pose"])
def test_a_position_sensor_reduces_the_position_uncertainty(kind):
    with_it, plain = (drive_of(kind, "augmented_ekf", use)[1].cov[-1] for use in (("imu", kind), ("imu",)))
    assert np.trace(with_it[:2, :2]) < 0.7 * np.trace(plain[:2, :2])


@pytest.mark.parametrize(
    ("kind", "keys", "atol"),
    [
        ("augmented_ekf", USE, 1e-12), ("ekf", NOISY, 1e-12), ("ekf", NOISY | {"mode": "paper"}, 1e-12),
        ("dead_reckoning", NOISY, 1e-12), ("complementary", {}, 1e-12),
        ("unscented", NOISY, 1e-4),  # whose sigma points do not turn with the map
    ],
)  # fmt: skip
def test_shifting_and_rotating_the_map_moves_the_estimate_equally(kind, keys, atol):
    file, run = drive_with("odometer")
    block = file.estimator(kind, **keys)
    ticks = make_ticks(run, block, len(run.t_ns))
    kernel = scan(block.row, block.init(), type(ticks)(*(x if x is None else _first(x) for x in ticks)))
    original = kernel.run(ticks, carry=block.init(eta=np.zeros(3)))[1]
    for turn in (3.1, -1.3):  # the drive turns left: from 3.1 rad across π
        start = np.array([3.0, -2.0, turn])
        moved_estimates = kernel.run(ticks, carry=block.init(eta=start))[1]
        expected = np.array([compose(start, eta) for eta in original.eta])
        np.testing.assert_allclose(moved_estimates.eta[:, :2], expected[:, :2], atol=min(atol, 1e-5))
        np.testing.assert_allclose(wrap(moved_estimates.eta[:, 2] - expected[:, 2]), 0.0, atol=atol)
        assert np.all(np.abs(moved_estimates.eta[:, 2]) <= np.pi)
        assert turn < 3.0 or np.min(moved_estimates.eta[:, 2]) < -3.0
        np.testing.assert_allclose(moved_estimates.nu, original.nu, atol=atol)
        J = np.eye(6)
        J[:3, :3] = map_from_body(turn)
        np.testing.assert_allclose(moved_estimates.cov, J @ original.cov @ J.T, atol=atol)
