"""A fit is judged on unseen runs."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from baqueano.errors import UsageError
from baqueano.identify import FitOptions, identify, random_steps
from baqueano.numerics.statistics import student_quantile
from baqueano.runs.run import Channel, Run
from baqueano.simulate import simulate
from baqueano.validation.held_out import ChannelMetrics, Validation, _ChannelError, _misfit_evidence, validate
from baqueano.vehicle_file import parse
from tests.codes import of_code

KINEMATIC = """
format = 1
name = "cart"
rate_hz = 100.0
[command]
names = ["u_x", "u_y", "u_psi"]
limit = [1.0, 0.0, 1.0]
[model]
kind = "kinematic"
velocity_matrix = [[0.3, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 2.0]]
[sensors.wheels]
kind = "wheels"
track_m = 0.2
noise_std = 0.01
"""


def run(file, seed, **changes):
    u = random_steps(file.command.limit, 15.0, file.rate_hz, seed)
    return simulate(file.with_values(changes), u, seed, name=f"run {seed}")


@pytest.fixture(scope="module")
def fit(small):
    return identify(run(small, 1), small)


def test_a_correct_model_explains_unseen_runs_as_well_as_fitted_runs(fit, small):
    validation = validate(fit, [run(small, 2), run(small, 3)])
    assert validation.verdict == "USABLE"
    assert [f.run for f in validation.figures] == ["run 2"] * 3 + ["run 3"] * 3
    noise = {f"imu[{k}]": s for k, s in enumerate(fit.sigma["imu"])}
    for figure in validation.figures:
        assert figure.error == pytest.approx(noise[figure.channel], rel=0.15)
        assert figure.explained_fraction == pytest.approx(figure.on_own_runs, abs=0.1)


def test_with_poses_each_segment_starts_from_a_fitted_velocity(small):
    """A run that begins at rest was "from a fitted velocity in 0 of 1 runs"."""
    u = np.concatenate([np.zeros((100, 3)), random_steps(small.command.limit, 14.0, small.rate_hz, 5)])
    runs = [simulate(small, u, seed, name=f"run {seed}") for seed in (5, 6)]
    runs = [replace(x, truth=x.truth._replace(nu=np.full_like(x.truth.nu, np.nan))) for x in runs]
    free = ["model.actuator_matrix[0,0]"]
    fit = identify(runs[0], small, free, use=("imu", "truth"), options=FitOptions(diagnose=False))
    basis = validate(fit, runs[1]).basis.figures
    assert (basis["span_s"], basis["start"].code) == ("5", "validation.from-velocity")


def test_the_tables_of_a_fit_and_of_its_held_out_runs_clip_outliers_alike(small):
    runs = [run(small, seed) for seed in (1, 2)]
    for single in runs:
        single.sensors["imu"].z[::20, 2] += 6.0
    fit = identify(runs[0], small)
    (figure,) = [f for f in validate(fit, runs[1]).figures if f.channel == "imu[2]"]
    (of_fit,) = [c.explained_fraction for c in fit.channels if (c.sensor, c.entry) == ("imu", 2)]
    assert figure.on_own_runs == pytest.approx(of_fit)
    assert figure.explained_fraction == pytest.approx(of_fit, abs=0.02)


def test_a_run_of_another_vehicle_is_not_explained(fit, small):
    turned_matrix = -np.asarray(small.value("model.actuator_matrix"))
    validation = validate(fit, run(small, 4, **{"model.actuator_matrix": turned_matrix.tolist()}))
    assert validation.verdict == "REFUSED"
    assert ("validation.worse-than-mean", "imu[2]", "run 4") in [
        (reason.code, reason.subject, reason.figures.get("run")) for reason in validation.reasons
    ]
    assert "REFUSED" in validation.table()


def test_a_bias_of_the_unseen_run_does_not_change_the_verdict(fit, small):
    validation = validate(
        fit, run(small, 5, **{"sensors.imu.gyro_bias": 0.1, "sensors.imu.accel_bias": [1.0, -1.0]})
    )
    assert validation.verdict == "USABLE"


def test_errors_on_unseen_runs_have_their_units(fit, small):
    validation = validate(fit, run(small, 2))
    assert [f.unit for f in validation.figures] == ["m/s²", "m/s²", "rad/s"]
    assert [row["unit"] for row in validation.rows()] == ["m/s²", "m/s²", "rad/s"]
    assert "rad/s" in validation.table()


def test_a_refused_fit_cannot_be_validated(fit, small):
    with pytest.raises(UsageError, check=of_code("validation.refused-fit")):
        validate(replace(fit, verdict="REFUSED"), run(small, 2))


def test_a_fitted_run_cannot_validate_the_fit(fit, small):
    with pytest.raises(UsageError, check=of_code("runs.fitted-to", run="run 1")):
        validate(fit, run(small, 1))
    assert validate(fit, replace(run(small, 2), name="run 1")).verdict == "USABLE"  # another run of that name


def test_students_quantile_equals_the_tables():
    for freedom, quantile in ((1, 63.657), (2, 9.925), (3, 5.841), (4, 4.604), (7, 3.499), (30, 2.750)):
        assert student_quantile(0.995, freedom) == pytest.approx(quantile, abs=6e-4)
        assert student_quantile(0.005, freedom) == pytest.approx(-quantile, abs=6e-4)
    for probability, freedom, quantile in ((0.975, 7, 2.3646), (0.975, 20, 2.0860), (0.999, 11, 4.0247)):
        assert student_quantile(probability, freedom) == pytest.approx(quantile, abs=6e-5)
    assert student_quantile(1.0 - 1.25e-5, 5) == pytest.approx(14.856, abs=6e-4)
    assert student_quantile(0.975, 1001.0) == pytest.approx(student_quantile(0.975, 999.0), abs=2e-5)


def alarms_of(blocks, own, noise=None):
    """Return the alarms of blocks with these logarithms of the mean square; `noise` replaces that of the fitted
    blocks."""
    square = np.exp(blocks).mean()
    noise = np.sqrt(np.exp(own).mean()) if noise is None else noise
    figure = ChannelMetrics("run 2", "imu[2]", np.sqrt(square), 0.0, 0.9, "rad/s", noise)
    error = _ChannelError(square, 0.0, blocks, 5.0 * np.arange(len(blocks)))
    return _misfit_evidence(figure, error, own, Path("my runs/run 2.mcap"))


@pytest.mark.parametrize(("count", "own"), [(1, 2), (2, 2), (6, 2), (2, 6), (3, 3), (4, 4), (12, 12)])
def test_the_false_alarm_rate_of_equal_blocks_is_one_percent(count, own):
    """The error is always large enough for an alarm. More than 36 of 2,000 would occur once in 2,000 tests by
    chance."""
    rng = np.random.default_rng(0)
    alarms = [alarms_of(rng.normal(size=count), rng.normal(size=own), noise=1e-9) for _ in range(2000)]
    assert sum(map(len, alarms)) <= 36


def test_a_run_with_a_large_error_is_reported_despite_few_blocks():
    rng = np.random.default_rng(0)
    for count, own in ((2, 2), (3, 3), (1, 6)):
        alarms = alarms_of(8.0 + rng.normal(0.0, 0.3, count), rng.normal(0.0, 0.3, own))
        assert alarms[0].code == "validation.error", (count, own)


def test_the_advice_to_cut_a_run_contains_its_file():
    (alarm,) = alarms_of(np.array([0.1, 0.0, 8.0, 0.2]), np.array([0.0, 0.2, 0.1, 0.1]))
    assert alarm.fix == "baqueano runs cut 'my runs/run 2.mcap' --to 10"


def test_two_blocks_give_only_a_possible_alarm():
    assert alarms_of(np.array([2.0]), np.array([0.0]))[0].code == "validation.error-possible"
    assert alarms_of(np.array([0.5]), np.array([0.0])) == []


def test_fitted_runs_that_lack_a_channel_are_ignored_for_this_channel(small):
    first, second = run(small, 1), run(small, 6)
    imu = second.sensors["imu"]
    deaf = imu._replace(z=imu.z * np.array([1.0, 1.0, np.nan]))
    fit = identify([first, replace(second, sensors={"imu": deaf})], small, options=FitOptions(diagnose=False))
    validation = validate(fit, run(small, 2))
    own = {f"{c.sensor}[{c.entry}]": c.explained_fraction for c in fit.channels if c.run == "run 1"}
    assert [f.channel for f in validation.figures] == ["imu[0]", "imu[1]", "imu[2]"]
    assert validation.figures[2].on_own_runs == pytest.approx(own["imu[2]"])
    assert "nan" not in validation.table()


@pytest.mark.parametrize(("backend", "seconds"), [("auto", 4.0), ("numpy", 1.5)])
def test_a_model_without_parameters_of_single_runs_can_be_validated(backend, seconds):
    rng, file = np.random.default_rng(0), parse(KINEMATIC, "cart")
    runs = []
    for seed in (1, 2):
        u = random_steps(file.command.limit, seconds, file.rate_hz, seed)
        v = u @ [[0.4], [0.0], [0.0]] + u @ [[0.0], [0.0], [3.0]] * [-0.1, 0.1]
        t_ns = 10_000_000 * np.arange(1, len(u) + 1)
        wheels = Channel(t_ns, t_ns, v + rng.normal(0.0, 0.01, v.shape))
        runs.append(Run(f"run {seed}", None, t_ns, u, sensors={"wheels": wheels}))
    free = ["model.velocity_matrix[0,0]", "model.velocity_matrix[2,2]"]
    fit = identify(runs[0], file, free, options=FitOptions(backend=backend))
    assert fit.run_entry_names == ()
    validation = validate(fit, runs[1])
    assert [f.channel for f in validation.figures] == ["wheels[0]", "wheels[1]"]
    assert min(f.explained_fraction for f in validation.figures) > 0.9


def test_extreme_and_nan_figures_are_printed_briefly():
    lost_figure = ChannelMetrics("run 2", "imu[2]", 1e50, -1e99, float("nan"), "rad/s", float("nan"))
    table = Validation((lost_figure, lost_figure._replace(noise=1e-9)), (), (), (), "").table()
    assert "nan" not in table
    assert "below -100 %" in table
    assert "over 1000×" in table
    assert max(map(len, table.splitlines())) < 100
