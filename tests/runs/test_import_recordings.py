"""The recordings of real cars, if they are available: CPM µCar and DART JetRacer.

Without them the tests are skipped by name; set BAQUEANO_DATA to their folder.
"""

import gzip

import numpy as np
import pytest

from baqueano.runs import import_run, read_run, write_run
from baqueano.runs.maps.column_map import data_folders
from baqueano.signals import NANOSECONDS

DATA = next((f for f in data_folders() if (f / "cpm_mucar").is_dir()), None)
recordings = pytest.mark.skipif(DATA is None, reason="recordings cpm_mucar, dart_jetracer: set BAQUEANO_DATA")


@recordings
@pytest.mark.parametrize(
    ("run", "rows", "new", "gaps", "start"),
    [("a", 3991, 3795, 10, 1557747108.5), ("b", 3035, 2380, 11, 1557750112.3)],
)
def test_the_cpm_runs_are_imported_with_commands_sensors_and_camera(run, rows, new, gaps, start):
    imported_run, findings = import_run(f"cpm_run_{run}")
    assert len(imported_run.t_ns) == rows - 1
    assert imported_run.t_ns[0] == round((start + 0.04) * NANOSECONDS)
    assert imported_run.sensors["odometer"].z.shape == (rows, 1)
    assert imported_run.sensors["imu"].z.shape == (new, 3)  # the other rows repeat the previous measurement
    assert np.abs(imported_run.applied_commands).max() <= 1.0
    assert [d.level for d in findings if d.level == "error"] == []
    assert sum(d.code == "gap" for d in findings) == gaps
    reasons = [d.reason for d in findings if d.code == "scale"]
    scale = next(reason for reason in reasons if reason.figures["key"] == "sensors.imu.z[2]")
    assert scale.code == "recording.against-truth"
    assert scale.figures["slope"] == pytest.approx(1.03, abs=0.005)  # in the recording: truth = 0.966 gyro


@recordings
def test_the_first_rows_of_a_cpm_run_match_the_file():
    run = import_run("cpm_run_a").run
    assert run.applied_commands[0].tolist() == [0.1980667148, -0.5153769373]
    assert run.sensors["imu"].z[0].tolist() == [0.3, -1.36, -0.9304786575]
    assert run.sensors["odometer"].z[0].tolist() == [0.4824207315]
    shift_ns = 1_557_747_108_500_000_000 - 5_066_844 + 45_000_000
    assert run.truth.t_ns[0] == shift_ns
    assert run.truth.eta[0].tolist() == pytest.approx([0.7124532987, 1.366614397, 2.443116926], abs=1e-15)


@recordings
def test_gyro_and_corrected_camera_clock_agree_within_10_ms():
    """The clock of the camera is corrected by 45 and 40 ms: afterwards its turning is delayed by less than 10 ms."""
    for name in ("cpm_run_a", "cpm_run_b"):
        run = import_run(name).run
        gyro, truth = run.sensors["imu"], run.truth
        t = (truth.t_ns[1:] + truth.t_ns[:-1]) / 2
        rate = np.diff(np.unwrap(truth.eta[:, 2])) / np.diff(truth.t_ns) * 1e9
        lags = np.arange(-60e6, 61e6, 5e6)
        agree = [np.corrcoef(rate, np.interp(t + lag, gyro.t_ns, gyro.z[:, 2]))[0, 1] for lag in lags]
        assert abs(lags[int(np.argmax(agree))]) <= 10e6


@recordings
def test_the_older_cpm_recording_is_imported_from_two_files():
    run, findings = import_run("cpm_pwm2018")
    assert run.t_ns[0] == 1_539_614_089_026_923_703
    assert run.applied_commands.min(axis=0).tolist() == [-0.514831543, -0.9999389648]
    assert run.truth is None
    assert {d.code for d in findings} == {"gap"}


@recordings
def test_every_csv_of_the_dart_car_is_imported():
    assert DATA is not None
    names = []
    for path in sorted((DATA / "dart_jetracer").glob("*.csv.gz")):
        with gzip.open(path, "rt", encoding="utf-8") as stream:
            kind = "dart_jetracer_vicon" if "vicon" in stream.readline() else "dart_jetracer"
        run = import_run(kind, [path]).run
        assert run.duration_s > 4.0
        assert (run.truth is not None) == (kind == "dart_jetracer_vicon")
        names.append(run.name)
    assert len(set(names)) == len(names) > 50


@recordings
def test_the_dart_bag_is_imported_and_stored(tmp_path):
    run = import_run("dart_jetracer_bag").run
    assert len(run.t_ns) == 633
    assert len(run.truth.t_ns) == 6320
    assert read_run(write_run(run, tmp_path / "0001-dart.mcap")) == run
