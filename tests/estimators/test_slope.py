"""A sloping floor pushes a vehicle in a direction of the map, so its speed error follows the heading."""

from dataclasses import replace

import numpy as np
import pytest

from baqueano.estimators.augmented.state import layout
from baqueano.runs.filter_ticks import example_filter_tick
from baqueano.signals import Slot, Tick
from baqueano.symbolic import scan
from baqueano.vehicle_file import load, parse

SMALL, STD_M_S = load("small"), 0.03
N = 1500


def estimates(file, u, turn_rad_s, std):
    """Return the estimates of a filter with the slope `std`, while its gyro reads a turn."""
    ekf = replace(file.estimator(), slope_speed_std_m_s=std)
    t_ns = 10_000_000 * np.arange(1, N + 1)
    z = np.outer(np.ones(N), [0.0, 0.0, turn_rad_s])
    slots = {"imu": Slot(np.ones(N), z, np.zeros(N))}
    if "odometer" in file.sensors._fields:
        slots["odometer"] = Slot(np.ones(N), np.full((N, 1), 0.3), np.zeros(N))
    ticks = Tick(t_ns, np.outer(np.ones(N), u), file.sensors._replace(**slots))
    kernel = scan(ekf.step, ekf.init(), example_filter_tick(ekf))
    _, estimate = kernel.run(ticks)
    return estimate


def growth(file, u, turn_rad_s):
    """Return the estimates, and what the slope adds to the covariances (N, 6, 6)."""
    sloping, level = (estimates(file, u, turn_rad_s, std) for std in (STD_M_S, 0.0))
    return sloping, sloping.cov - level.cov


def test_a_slope_shifts_a_vehicle_that_turns_in_both_axes_of_the_map():
    estimate, slope_cov = growth(SMALL, [0.5, 0.0, 0.1], 1.0)
    psi, speed = estimate.eta[:, 2], estimate.nu[:, 0]
    heading = np.stack([np.cos(psi), np.sin(psi)], axis=1)
    # φ moves the vehicle by M φ, with the sum M of the products of the headings
    M = np.cumsum(0.01 * heading[:, :, None] * heading[:, None, :], axis=0)
    expected = STD_M_S**2 * M[-1] @ M[-1].T
    assert speed[-1] > 0.1
    np.testing.assert_allclose(slope_cov[-1][:2, :2], expected, atol=0.1 * np.trace(expected))
    assert slope_cov[-1][3, 3] == pytest.approx(STD_M_S**2, rel=0.1)


def test_a_slope_does_not_move_a_vehicle_at_rest():
    _, slope_cov = growth(SMALL, [0.0, 0.0, 0.0], 0.0)
    assert np.max(np.abs(slope_cov)) < 1e-6


def test_a_measured_speed_includes_the_slope():
    text = SMALL.text.replace('kind = "augmented_ekf"', 'kind = "augmented_ekf"\nuse = ["imu", "odometer"]')
    file = parse(
        f'{text}\n[sensors.odometer]\nkind = "odometer"\nrate_hz = 100.0\nnoise_std = 0.02\n', "robot"
    )
    assert layout(file.estimator()).speed_is_measured
    _, slope_cov = growth(file, [0.5, 0.0, 0.1], 1.0)
    assert np.max(np.abs(slope_cov)) == 0.0
