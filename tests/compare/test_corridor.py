"""The corridor: hand calculations from a covariance, the loss of the vehicle, and the forecast of a drive."""

import numpy as np
import pytest

from baqueano.compare import compare
from baqueano.compare.corridor import corridor, corridor_row, run_corridor
from baqueano.compare.corridor_forecast import forecast_corridor
from baqueano.guides.shapes import circle, eight, sinuous_circle
from baqueano.simulate import simulate_loop
from baqueano.vehicle_file import load

SHARP = {"sensors.imu.gyro_scale_std": 0.003, "sensors.imu.gyro_bias_std": 2e-4}  # after two turns on a mark


def straight(cov, heading_rad=0.0):
    n = len(cov)
    eta = np.column_stack([np.arange(n), np.zeros(n), np.full(n, heading_rad)])
    return corridor(np.arange(float(n)), eta, np.array(cov))


def test_the_corridor_width_is_measured_across_the_heading():
    P = np.diag([0.04, 0.01, 0.0025])
    along_x, along_y = straight([P, P]), straight([P, P], 0.5 * np.pi)
    assert along_x.across_m == pytest.approx([0.196, 0.196])
    assert along_y.across_m == pytest.approx([0.392, 0.392])
    assert along_x.area_m2[0] == pytest.approx(np.pi * 5.991 * 0.2 * 0.1)
    assert along_x.heading_rad[0] == pytest.approx(1.96 * 0.05)
    message, width = along_x.message, along_x.message.figures["bound"]
    assert (message.code, message.figures["t_s"], width.code) == ("corridor.after-time", 1.0, "corridor.cm")
    assert width.figures == {"across_cm": pytest.approx(19.6), "heading_deg": pytest.approx(5.615, abs=0.001)}


def test_the_corridor_is_invariant_under_rotation_of_the_map():
    rng = np.random.default_rng(0)
    A = rng.standard_normal((3, 3))
    P, c, s = 0.01 * A @ A.T, np.cos(1.0), np.sin(1.0)
    R = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    straight_corridor, turned_corridor = straight([P]), straight([R @ P @ R.T], 1.0)
    assert turned_corridor.across_m == pytest.approx(straight_corridor.across_m)
    assert turned_corridor.area_m2 == pytest.approx(straight_corridor.area_m2)


@pytest.mark.parametrize("std", [0.51, np.nan])
def test_the_corridor_ends_at_a_heading_error_of_half_a_radian(std):
    P = [np.diag([0.01, 0.01, x**2]) for x in (0.1, 0.5, std, 0.1)]
    corridor = straight(P)
    assert (corridor.loss_s, len(corridor.t_s)) == (2.0, 2)
    assert (corridor.message.code, corridor.message.figures) == ("corridor.lost", {"t_s": 2.0})
    assert np.isnan(corridor_row(corridor)["corridor_across_m"])


def test_ellipse_and_half_width_cover_95_percent_of_a_normal_distribution():
    rng = np.random.default_rng(1)
    A = np.array([[0.3, 0.0], [0.2, 0.1]])
    e = rng.standard_normal((200_000, 2)) @ A.T
    P = np.zeros((1, 3, 3))
    P[0, :2, :2], P[0, 2, 2] = A @ A.T, 0.01
    corridor = straight(P)
    is_inside = np.einsum("ki,ij,kj->k", e, np.linalg.inv(A @ A.T), e) <= 5.991
    assert np.mean(is_inside) == pytest.approx(0.95, abs=0.002)
    assert np.mean(np.abs(e[:, 1]) <= corridor.across_m[0]) == pytest.approx(0.95, abs=0.002)


def test_run_and_comparison_report_the_corridor_after_each_lap():
    run = simulate_loop(load("small").with_values(SHARP), circle(0.3, 0.2), laps=2)
    corridor = run_corridor(run)
    assert corridor.lap_s == pytest.approx(0.5 * run.duration_s, abs=0.05)
    assert (corridor.message.code, corridor.message.figures["laps"]) == ("corridor.after-laps", 2)
    comparison = compare(run)
    assert corridor.sentence in " ".join(comparison.table().split())
    assert comparison.rows()[0]["corridor_across_m"] == corridor.across_m[-1]


def test_a_figure_eight_is_one_lap_although_its_path_crosses_the_start():
    run = simulate_loop(load("small").with_values(SHARP), eight(0.5, 0.2), laps=2)
    assert run_corridor(run).lap_s == pytest.approx(0.5 * run.duration_s, abs=0.05)


def test_the_forecast_agrees_with_the_corridor_computed_after_the_drive():
    file, route = load("small"), sinuous_circle(0.6, 0.06, 5, 0.2)
    prediction = forecast_corridor(file, route, 2)
    for seed in (1, 2):
        driven_corridor = run_corridor(simulate_loop(file, route, seed, laps=2))
        for row in prediction.rows():
            k = int(np.searchsorted(driven_corridor.t_s, row["t_s"])) - 1
            for name in ("across_m", "area_m2", "heading_rad"):
                assert row[name] == pytest.approx(getattr(driven_corridor, name)[k], rel=0.2), (name, seed)


def test_a_forecast_reports_the_time_at_which_the_vehicle_is_lost():
    file = load("small").with_values({"sensors.imu.gyro_scale_std": 0.05})
    prediction = forecast_corridor(file, circle(0.6, 0.2), 3)
    assert prediction.verdict == "LOST"
    assert prediction.corridor.message.code in ("corridor.lost", "corridor.lost-in-lap")
    assert np.isnan([row["across_m"] for row in prediction.rows()]).tolist() == [False, True, True]


@pytest.mark.parametrize(("key", "error"), [("gyro_bias", 0.0005), ("gyro_scale", 0.01)])
def test_a_small_bias_or_scale_error_lies_inside_the_corridor(key, error):
    file = load("small")
    truth = file.with_values({f"sensors.imu.{key}": file.value(f"sensors.imu.{key}") + error})
    route = sinuous_circle(0.6, 0.06, 5, 0.2)
    from baqueano.drive import repeat

    run = repeat(file, route, 2, truth=truth, seed=3)
    log = run.estimate
    e = log.eta - run.truth.eta[np.searchsorted(run.truth.t_ns, log.t_ns)]
    e[:, 2] = np.angle(np.exp(1j * e[:, 2]))
    for k in np.linspace(500, len(e) - 1, 8).astype(int):
        P = log.cov[k, :3, :3]
        assert e[k, :2] @ np.linalg.solve(P[:2, :2], e[k, :2]) <= 5.991
        assert abs(e[k, 2]) <= 1.96 * np.sqrt(P[2, 2])


def test_two_turns_on_a_mark_shrink_the_corridor():
    route = sinuous_circle(0.6, 0.06, 5, 0.2)
    file = load("small").with_values({"estimator.disturbance_std": [0.01, 0.9]})  # as a fit finds it
    before = forecast_corridor(file, route, 2).rows()[-1]
    after = forecast_corridor(file.with_values(SHARP), route, 2).rows()[-1]
    assert after["heading_rad"] < 0.3 * before["heading_rad"]
    assert after["area_m2"] < 0.5 * before["area_m2"]
