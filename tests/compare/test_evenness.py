"""Evenness on synthetic speeds and commands whose figures are exactly known."""

import numpy as np
import pytest

from baqueano.compare import compare, evenness
from baqueano.compare.evenness import Limits
from baqueano.controllers.schedule import script_commands
from baqueano.drive import experiment
from baqueano.runs.run import EstimateLog, ReferenceLog, Run, TruthLog
from baqueano.vehicle_file import load

N = 3001
T_NS = 10_000_000 * np.arange(N)
T_S = 0.01 * np.arange(N)
WHEELS = Limits(np.array([1.0, 0.0, 1.0]), "two_wheels", np.ones(2))


def steady(value=0.2):
    return np.full(N, value)


def test_a_constant_speed_error_leaves_the_drive_even():
    pace = evenness.speed_errors(T_NS, steady(0.23), steady())
    assert pace.error_m_s == pytest.approx(0.03)
    assert pace.error == pytest.approx(0.15)
    assert pace.unevenness == pytest.approx(0.0, abs=1e-12)


def test_speed_ripple_is_measured_by_its_rms():
    pace = evenness.speed_errors(T_NS, 0.2 + 0.1 * np.sin(2 * np.pi * 5 * T_S), steady())
    assert pace.error == pytest.approx(0.5 / np.sqrt(2), rel=0.01)
    assert pace.unevenness == pytest.approx(0.5 / np.sqrt(2), rel=0.01)


def test_a_slow_speed_error_hardly_changes_the_evenness():
    pace = evenness.speed_errors(T_NS, 0.2 + 0.1 * np.sin(2 * np.pi * 0.1 * T_S), steady())
    assert pace.error == pytest.approx(0.5 / np.sqrt(2), rel=0.05)
    assert pace.unevenness < 0.01


def test_speed_that_follows_a_changing_reference_is_even():
    reference_speed = 0.2 + 0.1 * np.sign(np.sin(T_S))
    assert evenness.speed_errors(T_NS, reference_speed, reference_speed) == pytest.approx(
        (0.0, 0.0, 0.0), abs=1e-12
    )


def test_the_start_from_rest_is_excluded_from_the_evenness():
    speed = np.where(T_S < 0.9, 0.0, 0.2)
    assert evenness.speed_errors(T_NS, speed, steady()).error == 0.0
    assert evenness.speed_errors(T_NS, speed, steady(), after_s=0.0).error > 0.1


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_the_braking_of_the_reference_at_its_end_is_excluded_from_the_evenness(sign):
    reference_speed = sign * 0.2 * np.clip((T_S[-1] - T_S) / 2.0, 0.0, 1.0)
    speed = np.where(T_S[-1] - T_S < 1.9, 0.5, reference_speed)
    assert evenness.speed_errors(T_NS, speed, reference_speed).error == 0.0
    cruising = evenness.is_driving(T_NS, reference_speed)
    assert (np.flatnonzero(cruising)[0], np.flatnonzero(cruising)[-1]) == (100, N - 1 - 200)


def test_a_reference_that_was_interrupted_at_speed_is_judged_until_its_end():
    slowing = 0.2 - 0.1 * T_S / T_S[-1]
    assert np.count_nonzero(evenness.is_driving(T_NS, slowing)) == N - 100


def test_backward_driving_is_judged_like_forward_driving():
    reverse = evenness.speed_errors(T_NS, steady(-0.23), steady(-0.2))
    assert reverse.error == pytest.approx(0.15)


def test_unknown_figures_of_evenness_are_nan():
    assert np.isnan(evenness.speed_errors(T_NS, steady(), steady(0.0)).error)
    assert np.isnan(evenness.speed_errors(T_NS, np.full(N, np.nan), steady())).all()
    assert np.isnan(evenness.speed_errors(T_NS[:0], steady()[:0], steady()[:0])).all()
    assert np.isnan(evenness.speed_errors(T_NS[:50], steady()[:50], steady()[:50])).all(), (
        "shorter than a second"
    )
    assert np.isnan(evenness.sign_changes(T_NS[:1], steady()[:1]))
    assert np.isnan(evenness.share_at_limit(np.zeros((0, 3)), WHEELS))


def test_gaps_in_the_speed_do_not_change_the_evenness():
    speed = 0.2 + 0.1 * np.sin(2 * np.pi * 5 * T_S)
    speed[1000:1500] = np.nan
    assert evenness.speed_errors(T_NS, speed, steady()).unevenness == pytest.approx(
        0.5 / np.sqrt(2), rel=0.02
    )


def test_timestamps_since_1970_give_the_same_evenness():
    speed = 0.2 + 0.1 * np.sin(2 * np.pi * 5 * T_S)
    later_ns = T_NS + 1_700_000_000_000_000_000
    assert evenness.speed_errors(later_ns, speed, steady()) == evenness.speed_errors(T_NS, speed, steady())
    assert evenness.sign_changes(later_ns, speed - 0.2) == evenness.sign_changes(T_NS, speed - 0.2)


def test_changes_of_sign_are_counted_per_second():
    u = np.where(np.floor(T_S + 1e-9) % 2 == 0, 0.4, -0.4)  # one at each of the seconds 1 to 30
    assert evenness.sign_changes(T_NS, u) == pytest.approx(1.0)


def test_noise_around_zero_and_a_pause_do_not_count_as_sign_changes():
    u = np.where(T_S < 15, 0.4, 0.0) + 1e-4 * np.random.default_rng(0).standard_normal(N)
    u[500:700] = 0.0
    assert evenness.sign_changes(T_NS, u) == 0.0
    assert evenness.sign_changes(T_NS, np.zeros(N)) == 0.0
    u[1600] = -0.1
    assert evenness.sign_changes(T_NS, u) == pytest.approx(1 / 30)


def test_a_wheel_at_its_limit_counts_although_both_commands_are_within_limits():
    u = np.tile([0.6, 0.0, 0.3], (4, 1))
    assert evenness.share_at_limit(u, WHEELS) == 0.0
    u[0] = [0.6, 0.0, 0.4]  # right wheel
    u[1] = [-0.6, 0.0, 0.5]  # left wheel, backwards
    assert evenness.at_limit(u, WHEELS).tolist() == [1.0, 1.0, 0.0, 0.0]
    assert evenness.share_at_limit(u, WHEELS._replace(mixing="none", channel=np.full(1, np.inf))) == 0.0


def test_a_command_scaled_to_its_limit_counts_despite_rounding():
    u = np.array([[0.7, 0.0, 0.5]])
    u /= np.abs(u[0, 0]) + np.abs(u[0, 2])
    assert evenness.share_at_limit(u * (1 - 1e-15), WHEELS) == 1.0


def test_unused_entries_and_unlimited_commands_are_never_at_a_limit():
    u = np.tile([1e6, 0.0, 0.0], (3, 1))
    assert evenness.share_at_limit(u, Limits(np.full(3, np.inf))) == 0.0
    assert evenness.share_at_limit(np.zeros((3, 3)), WHEELS) == 0.0


def test_a_nan_command_is_not_counted_in_the_limit_share():
    u = np.array([[1.0, 0.0, 0.0], [np.nan, np.nan, np.nan]])
    assert evenness.share_at_limit(u, WHEELS) == 1.0


@pytest.mark.parametrize("name", ["small", "car", "case-study-1"])
def test_limits_are_read_from_the_vehicle_text(name):
    file = load(name)
    limits = evenness.read_limits(file.text)
    assert limits is not None
    assert np.array_equal(limits.command, file.command.limit)
    assert limits.mixing == file.vehicle.drivetrain.mixing
    assert np.array_equal(
        limits.channel, np.broadcast_to(file.vehicle.drivetrain.limit, limits.channel.shape)
    )


@pytest.mark.parametrize(
    "text",
    ["", "format = 1", "not toml", "command = 3", '[command]\nnames = ["a"]\nlimit = [1.0, 1.0]',
     '[command]\nnames = ["a"]\n[model.drivetrain]\nmixing = "two_wheels"'],
)  # fmt: skip
def test_a_vehicle_text_without_limits_returns_none(text):
    assert evenness.read_limits(text) is None


def a_run(times, u, vehicle_text, **extra):
    """A straight drive for 30 s at a reference of 0.2 m/s, then 5 s at rest after the end of the guide."""
    t_ns = 10_000_000 * np.arange(3500)
    driving = times < 3001
    nu = np.column_stack([np.where(driving, 0.2, 0.0), 0 * times, 0 * times])
    eta = np.column_stack([0.01 * np.cumsum(nu[:, 0]), 0 * times, 0 * times])
    truth = nu + np.array([0.02, 0.0, 0.0])
    velocity = nu + np.array([0.01, 0.0, 0.0])
    parts = {
        "sent_commands": u,
        "estimate": EstimateLog(t_ns, eta + 0.001, velocity, np.tile(1e-4 * np.eye(6), (len(times), 1, 1))),
        "reference": ReferenceLog(t_ns, eta, nu, (~driving).astype(float)),
        "truth": TruthLog(t_ns, eta, truth, 0 * truth),
    }
    return Run("a", None, t_ns, np.zeros((len(times), 3)), vehicle_text=vehicle_text, **(parts | extra))


def run_with(**extra):
    times = np.arange(3500)
    u = np.column_stack([np.where(times % 4 == 0, 0.9, 0.3), 0 * times, np.full(len(times), 0.2)])
    u[3001:] = 0.0
    return a_run(times, u, extra.pop("vehicle_text", load("small").text), **extra)


def test_evenness_is_judged_by_truth_and_estimate_until_the_guide_ends():
    row = compare(run_with()).rows()[0]
    assert row["pace_true_error_m_s"] == pytest.approx(0.02)
    assert row["pace_true_error"] == pytest.approx(0.1, rel=1e-3)
    assert row["pace_estimate_error"] == pytest.approx(0.05, rel=1e-3)
    assert row["pace_true_unevenness"] < 1e-2
    assert row["saturated_fraction"] == pytest.approx(0.25, abs=1e-3)
    assert row["sign_changes_per_s"] == 0.0


def test_the_table_shows_the_evenness_of_the_drive():
    text = compare(run_with()).table()
    lines = [" ".join(line.split()) for line in text.splitlines()]
    assert "ticks at a limit % 25" in lines
    assert "speed error, relative % 10" in lines


def test_without_a_vehicle_file_the_share_at_a_limit_is_nan():
    row = compare(run_with(vehicle_text="")).rows()[0]
    assert np.isnan(row["saturated_fraction"])
    assert row["sign_changes_per_s"] == 0.0
    assert "at a limit" not in compare(run_with(vehicle_text="")).table()


def test_the_limits_of_another_vehicles_file_are_not_used():
    assert np.isnan(compare(run_with(vehicle_text=load("car").text)).rows()[0]["saturated_fraction"])


def test_without_true_speeds_the_estimated_speed_is_judged():
    run = run_with()
    assert run.truth is not None
    blind = run.truth._replace(nu=np.full((3500, 3), np.nan))
    for truth in (None, blind):
        row = compare(run_with(truth=truth)).rows()[0]
        assert np.isnan(row["pace_true_error"])
        assert row["pace_estimate_error"] == pytest.approx(0.05, rel=1e-3)


def test_a_drive_without_a_guide_is_judged_only_by_its_commands():
    row = compare(run_with(reference=None)).rows()[0]
    assert np.isnan(row["pace_true_error_m_s"])
    assert row["saturated_fraction"] == pytest.approx(0.25 * 3001 / 3500, rel=0.01)


def test_without_sent_commands_the_applied_command_is_judged():
    run = run_with(sent_commands=None)
    assert compare(run).rows()[0]["saturated_fraction"] == 0.0


def test_an_uneven_drive_is_distinguished_from_an_even_drive():
    small = load("small")
    script = [(0.2, [u, 0.0, 0.0]) for u in (1.0, -1.0)] * 10
    run = experiment(small, script_commands(script, 3, small.rate_hz))
    row = compare(run).rows()[0]
    assert row["sign_changes_per_s"] == pytest.approx(19 / 4, rel=0.02)
    assert row["saturated_fraction"] > 0.98


def test_a_command_against_a_reference_that_has_not_started_is_not_counted():
    """At rest, noise gives the command both signs; the reference starts 0.1 s later."""
    t_ns = np.arange(300) * 10_000_000
    speed_ref = np.clip(0.3e-9 * t_ns - 0.03, 0.0, 0.2)
    drives = evenness.is_driving(t_ns, speed_ref, 0.0)
    assert not drives[:16].any()
    assert drives[17:].all()
