"""An external truth identifies scales, bias, clock and mark within their error bars, without a vehicle model.

False-alarm rates for correct code: 36 of 42 numbers of six runs must lie inside their 95 % intervals. The rate is
below 0.5 % even if the numbers of one run are correlated; the seeds are fixed.
"""

import json
from dataclasses import replace

import numpy as np
import pytest

from baqueano.calibration.against_truth import calibrate
from baqueano.cli import main
from baqueano.errors import UsageError
from baqueano.identify import random_steps
from baqueano.numerics.statistics import batch_covariance, huber_regression, student_quantile
from baqueano.runs import write_run
from baqueano.runs.importing import import_run
from baqueano.runs.run import TruthLog
from baqueano.simulate import simulate
from baqueano.vehicle_file import load
from tests.codes import of_code

TRUE = {
    "clock.truth": 0.037,
    "sensors.imu.gyro_scale": 1.04,
    "sensors.imu.gyro_bias": 0.02,
    "sensors.odometer.scale": 0.97,
    "mark.x_m": 0.075,
    "mark.y_m": 0.0,
    "mark.heading_rad": 0.03,
}


def film(run, seed, late_s=TRUE["clock.truth"], turned_rad=TRUE["mark.heading_rad"]):
    """Return the run with the truth of a camera: 25 frames a second, noise, a clock `late_s` behind, a rotated mark."""
    rng, truth = np.random.default_rng(seed), run.truth
    eta = truth.eta[::2] + rng.normal(size=truth.eta[::2].shape) * [0.002, 0.002, 0.01] + [0, 0, turned_rad]
    no_values = np.full(eta.shape, np.nan)
    shifted_truth = TruthLog(truth.t_ns[::2] - round(late_s * 1e9), eta, no_values, no_values)
    first = np.searchsorted(shifted_truth.t_ns, 0)  # a run on disk does not contain negative times
    return replace(run, truth=TruthLog(*(column[first:] for column in shifted_truth)))


@pytest.fixture(scope="module")
def assumed_file():
    """Return the car of the garage with sensors that are assumed perfect."""
    return load("car").with_values(
        {"sensors.imu.gyro_scale": 1.0, "sensors.imu.gyro_bias": 0.0, "sensors.odometer.scale": 1.0}
    )


@pytest.fixture(scope="module")
def drive(assumed_file):
    """Return the function seed → a filmed run of a car with imperfect sensors."""
    truth = assumed_file.with_values(
        {name: value for name, value in TRUE.items() if name.startswith("sensors.")}
    )

    def run_of_seed(seed, duration_s=60.0):
        u = random_steps([0.5, 0.8], duration_s, truth.rate_hz, seed)
        return film(simulate(truth, u, seed), seed)

    return run_of_seed


def test_every_calibrated_value_is_within_its_error_bars(assumed_file, drive):
    counts = []
    for seed in range(6):
        fit = calibrate(drive(seed), assumed_file)
        assert fit.verdict == "USABLE", fit.reasons
        assert abs(fit.value("clock.truth") - TRUE["clock.truth"]) < 0.003
        counts += [row["low"] <= TRUE[row["name"]] <= row["high"] for row in fit.rows()]
    assert len(counts) == 42
    assert sum(counts) >= 36


def test_error_bars_of_the_calibration_are_narrow(assumed_file, drive):
    rows = {row["name"]: row for row in calibrate(drive(0), assumed_file).rows()}
    assert rows["sensors.imu.gyro_scale"]["std"] < 0.005
    assert rows["sensors.odometer.scale"]["std"] < 0.005
    assert rows["clock.truth"]["std"] < 0.003


def test_the_gyro_scale_is_reported_as_a_value_and_as_its_inverse(assumed_file, drive):
    fit = calibrate(drive(0), assumed_file)
    row = fit.rows()[1]
    assert row["name"] == "sensors.imu.gyro_scale"
    assert f" {1.0 / row['value']:.4f} × " in row["text"]
    assert "to be added to the truth's timestamps" in " ".join(fit.table().split())


def test_the_vehicle_file_receives_the_scales_and_their_provenance(assumed_file, drive):
    run = drive(0)
    fit = calibrate(run, assumed_file)
    file = fit.updated_file(assumed_file)
    assert file.value("sensors.imu.gyro_scale") == pytest.approx(1.04, abs=0.01)
    assert file.provenance["sensors.odometer.scale"].run == run.name
    second = {row["name"]: row for row in calibrate(run, file).rows()}
    assert second["sensors.imu.gyro_scale"]["file_value"] == pytest.approx(
        fit.value("sensors.imu.gyro_scale")
    )


def test_the_odometer_identifies_the_clock_without_a_gyro(assumed_file, drive):
    run = drive(1)
    fit = calibrate(replace(run, sensors={"odometer": run.sensors["odometer"]}), assumed_file)
    assert fit.value("clock.truth") == pytest.approx(TRUE["clock.truth"], abs=0.02)
    assert fit.rows()[0]["low"] < TRUE["clock.truth"] < fit.rows()[0]["high"]


def test_a_camera_jump_hardly_changes_the_calibration(assumed_file, drive):
    run = drive(2)
    eta = run.truth.eta.copy()
    eta[np.random.default_rng(0).integers(0, len(eta), 20)] += [0.5, -0.5, 1.0]
    fit = calibrate(replace(run, truth=run.truth._replace(eta=eta)), assumed_file)
    assert fit.value("sensors.imu.gyro_scale") == pytest.approx(1.04, abs=0.01)
    assert fit.value("clock.truth") == pytest.approx(TRUE["clock.truth"], abs=0.004)


def test_a_car_that_hardly_turns_gives_a_warning(assumed_file):
    u = random_steps([0.5, 0.0], 60.0, assumed_file.rate_hz, 0)
    fit = calibrate(film(simulate(assumed_file, u, 0), 0), assumed_file)
    assert fit.verdict == "WARN"
    assert "calibration.turn-more" in [reason.code for reason in fit.reasons]


def test_a_car_at_rest_determines_no_scale(assumed_file):
    fit = calibrate(film(simulate(assumed_file, np.zeros((3000, 2)), 0), 0), assumed_file)
    assert fit.verdict == "REFUSED"
    codes = {(reason.code, reason.subject) for reason in fit.reasons}
    assert ("calibration.not-determined", "sensors.imu.gyro_scale") in codes
    assert fit.updated_file(assumed_file).text == assumed_file.text


def test_a_dead_gyro_does_not_prevent_the_calibration_of_the_odometer(assumed_file, drive):
    run = drive(0)
    imu = run.sensors["imu"]
    flat_imu = imu._replace(z=imu.z * [1.0, 1.0, 0.0] + [0.0, 0.0, 0.02])
    fit = calibrate(replace(run, sensors=run.sensors | {"imu": flat_imu}), assumed_file)
    assert fit.verdict == "WARN"
    updated_file = fit.updated_file(assumed_file)
    assert updated_file.sensors.imu.gyro_scale == assumed_file.sensors.imu.gyro_scale
    assert set(updated_file.provenance) - set(assumed_file.provenance) == {"sensors.odometer.scale"}


def test_an_inverted_gyro_is_refused(assumed_file, drive, tmp_path, monkeypatch, capsys):
    run = drive(0)
    imu = run.sensors["imu"]
    inverted_imu = imu._replace(z=imu.z * [1.0, 1.0, -1.0])
    run = replace(run, sensors=run.sensors | {"imu": inverted_imu})
    fit = calibrate(run, assumed_file)
    assert [(reason.code, reason.subject) for reason in fit.reasons] == [
        ("calibration.inverted", "sensors.imu.gyro_scale")
    ]
    monkeypatch.chdir(tmp_path)
    assumed_file.save(tmp_path / "my.toml")
    write_run(run, tmp_path / "filmed.mcap")
    with pytest.raises(SystemExit) as exit_info:
        main(["runs", "calibrate", "filmed.mcap", "--vehicle", "my.toml", "--update", "--json"])
    assert exit_info.value.code == 1
    assert json.loads(capsys.readouterr().out)["verdict"] == "REFUSED"
    assert load(tmp_path / "my.toml").sensors.imu.gyro_scale == 1.0


def test_a_run_without_a_truth_is_refused_with_a_remedy(assumed_file, drive):
    with pytest.raises(UsageError, check=of_code("truth.none")):
        calibrate(replace(drive(0, 20.0), truth=None), assumed_file)


def test_a_truth_without_heading_is_refused_for_calibration(assumed_file, drive):
    run = drive(0, 20.0)
    eta = run.truth.eta * [1.0, 1.0, np.nan]
    with pytest.raises(UsageError, check=of_code("truth.no-heading")):
        calibrate(replace(run, truth=run.truth._replace(eta=eta)), assumed_file)


def test_a_run_without_a_sensor_is_refused(assumed_file, drive):
    with pytest.raises(UsageError, check=of_code("truth.no-sensor")):
        calibrate(replace(drive(0, 20.0), sensors={}), assumed_file)


def test_a_short_run_is_refused_with_its_length(assumed_file, drive):
    with pytest.raises(UsageError, check=of_code("truth.short-overlap", min_s=16.0)):
        calibrate(drive(0, 10.0), assumed_file)


def test_a_silent_camera_is_refused(assumed_file, drive):
    run = drive(0)
    sparse_truth = TruthLog(*(column[::25] for column in run.truth))
    with pytest.raises(UsageError, check=of_code("truth.silent", windows=0)):
        calibrate(replace(run, truth=sparse_truth), assumed_file)


def test_batch_error_bars_have_coverage_with_autocorrelated_residuals():
    """With 400 fits, error bars for white noise would cover 70 %. A false alarm outside 90 to 99 % is below 1e-4."""
    rng, n, batches, hits = np.random.default_rng(0), 400, 20, 0
    slopes = np.stack([np.ones(n), np.sin(np.arange(n) / 15.0)], axis=1)
    for _ in range(400):
        noise = np.convolve(rng.normal(size=n + 4), np.ones(5), "valid")
        x, weights = huber_regression(slopes, slopes @ [1.0, 2.0] + noise)
        cov = batch_covariance(
            slopes, slopes @ [1.0, 2.0] + noise - slopes @ x, weights, np.arange(n) * batches // n
        )
        hits += abs(x[1] - 2.0) < student_quantile(0.975, batches - 2) * np.sqrt(cov[1, 1])
    assert 0.90 <= hits / 400 <= 0.99


@pytest.mark.parametrize(("name", "late_s"), [("cpm_run_a", 0.045), ("cpm_run_b", 0.040)])
def test_a_real_gyro_and_its_camera_clock_are_calibrated(cpm_recordings, name, late_s):
    run = import_run(name).run  # its map already contains the offset
    fit = calibrate(run, load("car"))
    assert 1.0 / fit.value("sensors.imu.gyro_scale") == pytest.approx(0.966, abs=0.003)
    assert abs(fit.value("clock.truth")) < 0.010


def test_the_command_line_writes_the_scales_into_the_vehicle_file(
    assumed_file, drive, tmp_path, monkeypatch, capsys
):
    monkeypatch.chdir(tmp_path)
    assumed_file.save(tmp_path / "my.toml")
    write_run(drive(0), tmp_path / "filmed.mcap")
    with pytest.raises(SystemExit) as exit_info:
        main(["runs", "calibrate", "filmed.mcap", "--vehicle", "my.toml", "--update", "--json"])
    assert exit_info.value.code == 0
    reply = json.loads(capsys.readouterr().out)
    assert reply["verdict"] == "USABLE"
    scales = {row["name"]: row["value"] for row in reply["rows"]}
    scale = load(tmp_path / "my.toml").sensors.imu.gyro_scale
    assert scale == pytest.approx(scales["sensors.imu.gyro_scale"], rel=1e-4)
    assert scale == pytest.approx(1.04, abs=0.01)
