"""The position of a camera mark on the vehicle: calibrated, written to the map, removed at the next import."""

import json
import tomllib

import numpy as np
import pytest

from baqueano.cli import main
from baqueano.errors import FileError, UsageError
from baqueano.geometry import wrap
from baqueano.identify import random_steps
from baqueano.runs.importing import import_run
from baqueano.runs.maps.mount import Mount, write_mount
from baqueano.simulate import simulate
from baqueano.vehicle_file import load
from tests.codes import refused

TRUE = Mount(0.04, (0.06, -0.03), 0.05)
MAP = """format = 1
name = "filmed"

[files.log]
path = "log.csv"
time = "t"
time_unit = "s"

[files.camera]
path = "camera.csv"
time = "t"
time_unit = "s"

[ticks]
file = "log"

[command]
file = "log"
names = ["throttle", "servo"]
in_force = "until"
u = [{ column = "throttle", unit = "1" }, { column = "servo", unit = "1" }]

[sensors.imu]
file = "log"
z = [{ constant = nan }, { constant = nan }, { column = "gyro", unit = "rad/s" }]

[sensors.odometer]
file = "log"
z = [{ column = "speed", unit = "m/s" }]

[truth]   # a camera above the floor
file = "camera"
eta = [{ column = "x", unit = "m" }, { column = "y", unit = "m" }, { column = "psi", unit = "rad" }]
"""


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    """Return a folder with the log of a car and camera data of a mark that is not at the origin, 40 ms too early."""
    folder = tmp_path_factory.mktemp("filmed")
    car = load("car")
    run = simulate(car, random_steps([0.5, 0.8], 60.0, car.rate_hz, 3), 3)
    imu, odometer = run.sensors["imu"].z[:, 2], run.sensors["odometer"].z[:, 0]
    rows = np.column_stack([run.t_s, run.applied_commands, imu, odometer])
    np.savetxt(folder / "log.csv", rows, delimiter=",", header="t,throttle,servo,gyro,speed", comments="")
    rng, psi = np.random.default_rng(0), run.truth.eta[::2, 2]
    (forward, left), c, s = TRUE.lever_arm_m, np.cos(psi), np.sin(psi)
    x, y = run.truth.eta[::2, 0] + c * forward - s * left, run.truth.eta[::2, 1] + s * forward + c * left
    eta = np.column_stack([x, y, wrap(psi + TRUE.heading_rad)]) + rng.normal(size=(len(x), 3)) * 0.002
    camera = np.column_stack([run.t_s[::2] - TRUE.shift_s, eta])
    np.savetxt(folder / "camera.csv", camera[3:], delimiter=",", header="t,x,y,psi", comments="")
    (folder / "filmed.toml").write_text(MAP, encoding="utf-8")
    return folder, run


def exit_code(*words):
    with pytest.raises(SystemExit) as exit_info:
        main(list(words))
    return exit_info.value.code


def test_the_next_import_removes_the_camera_mount_that_calibration_wrote(
    recording, tmp_path, monkeypatch, capsys
):
    folder, run = recording
    monkeypatch.chdir(tmp_path)
    for path in folder.iterdir():
        (tmp_path / path.name).write_bytes(path.read_bytes())
    assert exit_code("runs", "import", "filmed.toml", "-o", "first.mcap") == 0
    words = ["--vehicle", "car", "--map", "filmed.toml"]
    assert exit_code("runs", "calibrate", "first.mcap", *words) == 0
    text = (tmp_path / "filmed.toml").read_text(encoding="utf-8")
    mount = tomllib.loads(text)["truth"]
    assert "# a camera above the floor" in text
    assert "(95 %), runs calibrate first" in text
    assert mount["shift_s"] == pytest.approx(TRUE.shift_s, abs=0.004)
    assert mount["lever_arm_m"] == pytest.approx(TRUE.lever_arm_m, abs=0.006)
    assert mount["heading_rad"] == pytest.approx(TRUE.heading_rad, abs=0.015)
    second = import_run("filmed.toml").run
    error = second.truth.eta[50:-50, :2] - np.column_stack(
        [np.interp(second.truth.t_ns[50:-50], run.t_ns, column) for column in run.truth.eta[:, :2].T]
    )
    assert np.hypot(*error.T).mean() < 0.01, "7 cm before"
    capsys.readouterr()
    assert exit_code("runs", "calibrate", "first.mcap", *words) == 2
    assert "Import the run again, and calibrate the new run" in capsys.readouterr().err
    assert exit_code("runs", "import", "filmed.toml", "-o", "second.mcap") == 0
    capsys.readouterr()
    assert exit_code("runs", "calibrate", "second.mcap", "--vehicle", "car", "--json") == 0
    rows = {row["name"]: row for row in json.loads(capsys.readouterr().out)["rows"]}
    assert rows["clock.truth"]["value"] == pytest.approx(0.0, abs=0.002)
    assert rows["mark.x_m"]["value"] == pytest.approx(0.075, abs=0.006)  # the origin, ahead of the rear axle


def test_pose_and_velocity_are_corrected_by_the_mount():
    rng, forward, left = np.random.default_rng(1), 0.3, -0.2
    eta, nu = rng.normal(size=(20, 3)), rng.normal(size=(20, 3))
    c, s, w = np.cos(eta[:, 2]), np.sin(eta[:, 2]), nu[:, 2]
    mark = np.column_stack(
        [eta[:, 0] + c * forward - s * left, eta[:, 1] + s * forward + c * left, eta[:, 2] + 0.4]
    )
    vx, vy = nu[:, 0] - w * left, nu[:, 1] + w * forward
    own_frame = np.column_stack([np.cos(0.4) * vx + np.sin(0.4) * vy, np.cos(0.4) * vy - np.sin(0.4) * vx, w])
    body, body_nu = Mount(0.0, (forward, left), 0.4).body_motion(mark, own_frame)
    np.testing.assert_allclose(body[:, :2], eta[:, :2], atol=1e-12)
    np.testing.assert_allclose(wrap(body[:, 2] - eta[:, 2]), 0.0, atol=1e-12)
    np.testing.assert_allclose(body_nu, nu, atol=1e-12)


def test_two_successive_mounts_equal_their_composition():
    first, second = Mount(0.01, (0.1, 0.2), 0.3), Mount(0.02, (-0.05, 0.07), -0.1)
    eta = np.random.default_rng(2).normal(size=(20, 3))
    unknown = np.full((20, 3), np.nan)
    by_two = second.body_motion(first.body_motion(eta, unknown)[0], unknown)[0]
    by_one = first.compose(second).body_motion(eta, unknown)[0]
    np.testing.assert_allclose(by_one[:, :2], by_two[:, :2], atol=1e-12)
    np.testing.assert_allclose(wrap(by_one[:, 2] - by_two[:, 2]), 0.0, atol=1e-12)
    assert first.compose(second).shift_s == pytest.approx(0.03)


def test_a_lever_arm_without_a_heading_is_refused(recording, tmp_path):
    text = (
        MAP.replace('{ column = "psi", unit = "rad" }', "{ constant = nan }") + "lever_arm_m = [0.1, 0.0]\n"
    )
    (tmp_path / "gps.toml").write_text(text, encoding="utf-8")
    with refused("expect.no-mount", FileError):
        import_run(tmp_path / "gps.toml")


def test_a_lever_arm_of_one_number_is_refused(tmp_path):
    (tmp_path / "m.toml").write_text(f"{MAP}lever_arm_m = [0.1]\n", encoding="utf-8")
    with refused("expect.lever-arm", FileError):
        import_run(tmp_path / "m.toml")


def test_a_map_that_is_not_a_file_is_reported(recording, tmp_path):
    with refused("map.not-file", UsageError, run="simulation"):
        write_mount(tmp_path / "none.toml", recording[1], {}, {})
