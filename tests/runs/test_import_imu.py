"""An import makes gaps of readings of an IMU at full scale, and compares gyro, compass, speed and commands."""

import re

import numpy as np
import pytest

from baqueano.runs.importing.draft import draft_map
from baqueano.runs.importing.recordings import import_runs
from tests.codes import includes
from tests.runs.conftest import write_csv


def test_gyro_words_at_the_rail_become_gaps_of_the_gyro_alone(lab):
    scale, truth = 1.5 / 32768.0, lab.board["wz"]
    lab.board["wz"] = np.clip(np.round(truth / scale), -32768, 32767)
    lab.edit('"wz", unit = "rad/s"', f'"wz", unit = "raw", scale = {scale}')
    at_rail = np.abs(truth) > 1.5
    assert 0 < at_rail.sum() < 90
    run, findings = lab.run()
    z = run.sensors["imu"].z
    assert len(z) == 1500
    assert not np.isfinite(z[at_rail, 2]).any()
    assert np.isfinite(z[:, :2]).all()
    assert np.isfinite(z[np.abs(truth) < 1.3, 2]).all()
    (finding,) = (d for d in findings if d.code == "full scale")
    assert finding.level == "warning"
    assert finding.reason.figures["full_scale_count"] == at_rail.sum()
    assert finding.reason.figures["excluded_rows"] == np.isnan(z[:, 2]).sum()
    assert lab.run().verdict == "WARN"


def test_a_gyro_that_only_comes_near_its_rail_keeps_all_readings(lab):
    scale = np.max(np.abs(lab.board["wz"])) / 32766.0
    lab.board["wz"] = np.round(lab.board["wz"] / scale)
    lab.edit('"wz", unit = "rad/s"', f'"wz", unit = "raw", scale = {scale}')
    run, findings = lab.run()
    assert np.isfinite(run.sensors["imu"].z).all()
    assert "full scale" not in {d.code for d in findings}


COMPASS = """[sensors.compass]
file = "board"
z = [{ column = "bearing", unit = "deg" }]
[truth]"""


def test_a_compass_that_counts_clockwise_is_refused_with_the_line_to_write(lab):
    heading = np.cumsum(lab.board["wz"]) * 0.02
    lab.board["bearing"] = np.mod(90.0 - np.degrees(heading), 360.0)
    lab.edit("[truth]", COMPASS)
    reason = lab.refused(
        "recording.yaw-rates-opposite", wheels="sensors.compass.z[0]", reference="sensors.imu.z[2]"
    )
    assert includes(reason, "recording.write-compass", scale="-1", compass="sensors.compass.z[0]")
    lab.edit('"bearing", unit = "deg"', '"bearing", unit = "deg", scale = -1.0, offset = 1.5707963')
    run, findings = lab.run()
    assert "inverted" not in {d.code for d in findings}
    error = np.angle(np.exp(1j * (run.sensors["compass"].z[:, 0] - heading)))
    assert np.abs(error).max() < 0.05


def test_a_speed_without_a_sign_in_one_run_lacks_it_in_all_runs_of_the_map(tmp_path):
    """The second run reverses once for 1.2 s: too seldom to show by itself that the speed lacks its sign."""
    t, paths = 0.02 * np.arange(1500), []
    often = np.sin(0.7 * t)
    speeds = [often, np.where(np.abs(t - 15.7) < 0.6, -np.cos(2.6 * (t - 15.7)), np.abs(often))]
    for k, v in enumerate(speeds):
        columns = {"t_s": t, "throttle": 0.4 * v, "steer": 0.2 * np.sin(t), "speed_m_s": np.abs(v)}
        paths.append(write_csv(tmp_path / f"{k}.csv", columns))
    (tmp_path / "map.toml").write_text(draft_map(paths[0]), encoding="utf-8")
    assert "no sign" not in {d.code for d in import_runs(tmp_path / "map.toml", paths[1:])[0].findings}
    for imported_log, v in zip(import_runs(tmp_path / "map.toml", paths), speeds, strict=True):
        odometer = imported_log.run.sensors["odometer"]
        since_s = (odometer.t_ns - imported_log.run.t_ns[0]) * 1e-9 + t[1]
        assert np.min(np.interp(since_s, t, v)) > -0.1
        assert "recording.no-sign-excluded" in {finding.reason.code for finding in imported_log.findings}


@pytest.mark.parametrize(("floor", "is_signed"), [(-9.0, False), (-9.0, True), (0.0, False), (0.0, True)])
def test_a_speed_without_a_sign_is_named_only_if_the_vehicle_drives_backward(lab, floor, is_signed):
    t = lab.board["t"]
    v = np.maximum(np.sin(0.7 * t), floor)
    lab.board["throttle"] = 0.4 * (np.sin(0.7 * t) + 0.3 * np.cos(0.7 * t))
    lab.board["speed"] = (v if is_signed else np.abs(v)) + 0.005 * np.random.default_rng(0).standard_normal(
        len(t)
    )
    blocks = r"\[files\.camera\].*?(?=\[ticks\])|\[sensors\.imu\].*?(?=\[sensors\.odo)|\[truth\].*"
    lab.map = re.sub(blocks, "", lab.map, flags=re.DOTALL)
    run, findings = lab.run()
    is_unsigned = floor < 0.0 and not is_signed
    assert ("no sign" in [finding.code for finding in findings]) == is_unsigned
    if is_unsigned:  # only readings in which the vehicle moves forward remain
        true_v = np.interp(run.sensors["odometer"].t_ns, 1_000_000_000 + np.rint(1e9 * t), v)
        assert np.min(true_v) > -0.05
        assert np.sum(true_v > 0.05) > 0.75 * np.sum(v > 0.05)
