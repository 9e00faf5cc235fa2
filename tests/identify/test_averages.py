"""Rates from counts are means over the time between two counts, and a fit compares them with means of the model."""

import numpy as np
import pytest

from baqueano.identify import FitOptions, Residuals, dataset, parameters_of
from baqueano.identify.data.averaging import AveragedSignal, average_step, averaged_readings, averages
from baqueano.runs.importing.recordings import import_run
from baqueano.runs.run import Channel, Run
from baqueano.sensors import Odometer
from baqueano.signals import Motion
from baqueano.vehicle_file import parse

MASS_KG, PUSH_N, DRAG, DELAY_S, RADIUS_M = 0.8, 3.4, 6.0, 0.013, 0.03
FREE = ["model.actuator_matrix[0,0]", "model.friction.linear[0]", "model.drivetrain.delay_s"]
FILE = f"""
format = 1
name = "cart"
rate_hz = 10.0
[command]
names = ["u_x", "u_y", "u_psi"]
unit = "duty"
limit = [1.0, 0.0, 1.0]
[model]
kind = "planar"
mass_kg = {MASS_KG}
inertia_kg_m2 = 0.002
actuator_matrix = [[{PUSH_N}, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 0.1]]
[model.friction]
linear = [{DRAG}, 10.0, 0.01]
[model.drivetrain]
delay_s = {DELAY_S}
[sensors.wheels]
kind = "wheels"
track_m = 0.12
"""
MAP = """
format = 1
files.log = { time = "t_ms", time_unit = "ms" }
command = { names = ["u_x", "u_y", "u_psi"], in_force = "from", u = [
  { column = "duty", unit = "raw", scale = 1.0 }, { constant = 0.0 }, { constant = 0.0 } ] }
sensors.wheels = { z = [
  { column = "counts", counts_per_turn = 1000000, radius_m = 0.03, derivative = true, unit = "counts" },
  { column = "counts", counts_per_turn = 1000000, radius_m = 0.03, derivative = true, unit = "counts" } ] }
"""


def distance_m(t_s, edges_s, duties):
    """Return the distance (N,) at t_s (N,): m v̇ = T u − d v has a closed form for each constant command."""
    s = v = 0.0
    out, fade = np.zeros(len(t_s)), DRAG / MASS_KG
    for first, last, duty in zip(edges_s, [*edges_s[1:], np.inf], duties, strict=True):
        is_in, end = (t_s >= first) & (t_s <= last), PUSH_N * duty / DRAG
        out[is_in] = (
            s + end * (t_s[is_in] - first) + (v - end) / fade * (1 - np.exp(-fade * (t_s[is_in] - first)))
        )
        if np.isfinite(last):
            decay = np.exp(-fade * (last - first))
            s, v = s + end * (last - first) + (v - end) / fade * (1.0 - decay), end + (v - end) * decay
    return out


def import_counts(folder, t_s):
    """Return the import of counts and commands at `t_s` (80,) [s], whole milliseconds."""
    duty = np.repeat([0.0, 0.8, -0.5, 0.3, 0.0, 0.9, 0.2, -0.7], 10)
    counts = np.rint(
        distance_m(t_s, [0.0, *(t_s[1:] + DELAY_S)], [0.0, *duty[1:]]) / RADIUS_M / (2e-6 * np.pi)
    )
    rows = [f"{1000.0 * t:.0f},{u},{n:.0f}" for t, u, n in zip(t_s, duty, counts, strict=True)]
    (folder / "log.csv").write_text("\n".join(["t_ms,duty,counts", *rows]))
    (folder / "map.toml").write_text(MAP)
    return import_run(folder / "map.toml", [folder / "log.csv"]).run


@pytest.fixture
def run(tmp_path):
    return import_counts(tmp_path, 0.1 * np.arange(80))


def problem_of(run, file=FILE, backend="numpy", free=FREE, **options):
    data = dataset([run], parse(file, "cart.toml"))
    parameters = parameters_of(data, free, FitOptions(at_rest=True, **options))
    return Residuals.from_parameters(parameters, backend), parameters.start


def test_rates_from_counts_at_10_hz_equal_the_predictions_of_the_true_model(run):
    problem, theta = problem_of(run)
    mask = problem.masks[0] > 0.0
    assert mask[:, 0].sum() == 79
    misfit = problem.misfits(theta)[0][mask]
    # m/s; 0.007 if the reading is compared with the middle of its interval
    assert np.abs(misfit).max() < 1e-4


def test_the_interval_of_an_imported_rate_ends_at_its_later_count(tmp_path):
    uneven_ms = 100 * np.arange(80) + np.random.default_rng(5).integers(-30, 31, 80) * (np.arange(80) > 0)
    problem, theta = problem_of(import_counts(tmp_path, 1e-3 * uneven_ms))
    assert problem.masks[0][:, 0].sum() == 78  # the first begins before the rows
    assert np.abs(problem.misfits(theta)[0]).max() < 1e-4  # 0.006 if it ends midway between two timestamps


def test_a_block_of_counts_averages_in_the_same_way_without_the_import(run):
    counters = 'kind = "encoders"\ncount_m = 1.9e-7\nrate_hz = 10.0'
    counts = Run("counts", None, run.t_ns, run.applied_commands, sensors=run.sensors)
    problem, theta = problem_of(counts, FILE.replace('kind = "wheels"', counters))
    assert np.array_equal(problem.misfits(theta)[0], problem_of(run)[0].misfits(theta)[0])


def test_a_delayed_sensor_averages_its_delayed_signal(run):
    late_ns = run.sensors["wheels"].t_ns + 20_000_000  # by one row, so that no interval ends within a row
    later_run = Run("late", None, run.t_ns, run.applied_commands, metadata=run.metadata,
               sensors={"wheels": Channel(late_ns, late_ns, run.sensors["wheels"].z)})  # fmt: skip
    problem, theta = problem_of(later_run, f"{FILE}delay_s = 0.02\n")
    assert np.abs(problem.misfits(theta)[0]).max() < 1e-4


def test_a_free_clock_shifts_the_interval_of_a_mean(run):
    c = run.sensors["wheels"]
    shifted_channel = Channel(c.t_ns - 40_000_000, c.arrival_ns - 40_000_000, c.z)  # two rows
    run = Run(
        "early",
        None,
        run.t_ns,
        run.applied_commands,
        metadata=run.metadata,
        sensors={"wheels": shifted_channel},
    )
    problem, theta = problem_of(run, free=FREE[:2], clocks=("wheels",))  # a free delay is the same shift
    assert problem.masks[0][:, 0].sum() > 70
    theta = np.append(theta[:2], 0.04)
    assert np.abs(problem.misfits(theta)[0]).max() < 1e-4  # 0.007 if the mean is compared with an instant


def test_the_sensitivities_of_means_are_the_derivatives_of_the_residuals(run):
    problem, theta = problem_of(run, backend="python")
    _, slopes, _ = problem.sensitivities(theta)[0]
    for k in range(len(theta)):
        step = 1e-6 * np.eye(len(theta))[k]
        finite = (problem.residuals(theta + step)[0] - problem.residuals(theta - step)[0]) / 2e-6
        assert slopes[..., k] == pytest.approx(finite, abs=1e-5)


def test_a_mean_of_a_parabola_is_exact_in_rows_of_any_length():
    rng = np.random.default_rng(3)
    dt_s = rng.uniform(0.002, 0.03, 200)
    ends, readings = np.cumsum(dt_s), np.arange(0.05, 2.5, 0.0371)
    used_readings, rows, weights = averaged_readings(readings, np.full(len(readings), 0.0371), ends, dt_s)
    sensor = Odometer()

    def motion(t):
        return Motion(
            np.zeros(3), np.array([1.0 + 2.0 * t - 3.0 * t * t, 0.0, 0.0]), np.zeros(3), np.zeros(2)
        )

    state, means = AveragedSignal(np.zeros((0, 1)), np.zeros(0), np.zeros(0), np.zeros(1), np.zeros(1)), []
    for end, dt, w in zip(ends, dt_s, weights, strict=True):
        tick = motion(end - dt), motion(end - 0.5 * dt), motion(end)
        state, h = average_step(sensor, state, tick[2]._replace(tick=tick), dt, w)
        means.append(h[0])
    t, half = readings[used_readings], 0.5 * 0.0371
    assert len(used_readings) > 40
    assert np.array(means)[rows] == pytest.approx(1.0 + 2.0 * t - 3.0 * (t * t + half * half / 3.0))
    line = averages(weights, 1.0 + 2.0 * ends[:, None])
    assert line[rows, 0] == pytest.approx(1.0 + 2.0 * t)
