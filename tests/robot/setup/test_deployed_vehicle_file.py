"""`baqueano robot setup` updates the vehicle file of the robot and preserves all calibrated values there."""

import zlib
from datetime import date
from functools import partial

import pytest

from baqueano import vehicle_file
from baqueano.cli import main
from baqueano.errors import RobotUnreachable, UsageError
from baqueano.robot.setup import install, steps
from baqueano.robot.setup.install import TargetMachine, remove, setup
from tests.codes import refused

PI = TargetMachine((3, 11), "aarch64", "ana")
SMALL = vehicle_file.load("small")
CALIBRATION = {"robot.imu_axes": ["-y", "x", "z"], "sensors.imu.gyro_bias": 0.0123}


def calibrated(file, values=CALIBRATION, on=date(2026, 11, 3)):
    """Return the file as `calibrate imu --update` writes it."""
    return file.with_values(values, {key: {"run": "calibrate imu", "date": on} for key in values})


@pytest.fixture
def vehicle_toml(pi, wheels):
    """Return the vehicle file of a robot that already has its packages."""
    (pi / "opt/baqueano").mkdir()
    names = [f"{wheel.name} {zlib.crc32(wheel.read_bytes()):08x}" for wheel in sorted(wheels.glob("*.whl"))]
    (pi / "opt/baqueano/bundle.txt").write_text("\n".join(names))
    path = pi / "var/lib/baqueano/vehicle.toml"
    path.parent.mkdir()
    path.write_text(SMALL.text)
    return path


def test_a_changed_vehicle_file_is_deployed_with_a_backup(programs, pi, wheels, vehicle_toml, capfd):
    file, lines = vehicle_file.override(SMALL, ["robot.port=/dev/serial0", "robot.least_battery_v=6.0"]), []
    setup("r1", wheels, PI, vehicle=file, notify=lines.append, is_dry_run=True, root=str(pi))
    changes = [
        'vehicle.toml  robot.port: not there → "/dev/serial0"',
        "vehicle.toml  robot.least_battery_v: not there → 6.0",
    ]
    assert lines == changes
    assert (
        "would    /var/lib/baqueano/vehicle.toml; the previous file is vehicle.toml.before"
        in capfd.readouterr().out
    )
    assert vehicle_toml.read_text() == SMALL.text
    setup("r1", wheels, PI, vehicle=file, notify=lines.append, root=str(pi))
    assert lines == 2 * changes
    assert vehicle_toml.read_text() == file.text
    before = vehicle_toml.with_name("vehicle.toml.before")
    assert before.read_text() == SMALL.text
    lines.clear()
    setup("r1", wheels, PI, vehicle=file, notify=lines.append, root=str(pi))
    assert lines == []
    assert "as it is /var/lib/baqueano/vehicle.toml\n" in capfd.readouterr().out
    remove("r1", PI, root=str(pi))
    assert (vehicle_toml.read_text(), before.read_text()) == (file.text, SMALL.text)


@pytest.mark.parametrize("vehicle", [SMALL, None])
def test_an_empty_vehicle_file_is_replaced(programs, pi, wheels, vehicle_toml, vehicle):
    vehicle_toml.write_text("")
    setup("r1", wheels, PI, vehicle=vehicle, root=str(pi))
    assert vehicle_toml.read_text() == ("# mine\n" if vehicle is None else SMALL.text)


@pytest.mark.parametrize("name", ["vehicle.toml.part", "vehicle.toml.before"])
def test_root_writes_no_vehicle_file_through_a_link(programs, pi, wheels, vehicle_toml, tmp_path, name):
    path = tmp_path / "cron"
    path.write_text("of root")
    vehicle_toml.with_name(name).symlink_to(path)
    file = vehicle_file.override(SMALL, ["robot.port=/dev/serial0"])
    setup("r1", wheels, PI, vehicle=file, root=str(pi))
    assert (path.read_text(), vehicle_toml.read_text()) == ("of root", file.text)


@pytest.mark.parametrize("when", ["2026-11-03T10:00:00Z", "2026-11-03T10:00:00", '"2026-11-03"'])
def test_a_calibration_with_any_kind_of_date_is_compared(programs, pi, wheels, vehicle_toml, when):
    vehicle_toml.write_text(calibrated(SMALL).text.replace("2026-11-03", when))
    file = calibrated(SMALL, {"robot.imu_axes": ["y", "-x", "z"]}, on=date(2026, 11, 2))
    setup("r1", wheels, PI, vehicle=file, root=str(pi))
    axes = vehicle_file.load(vehicle_toml).robot.imu_axes
    assert axes == (("y", "-x", "z") if '"' in when else ("-y", "x", "z"))


@pytest.mark.parametrize("text", ["provenance = 3", "[provenance]\nmodel = 3"])
def test_a_damaged_provenance_of_the_robot_is_replaced(programs, pi, wheels, vehicle_toml, text):
    vehicle_toml.write_text(text)
    setup("r1", wheels, PI, vehicle=SMALL, root=str(pi))
    assert vehicle_toml.read_text() == SMALL.text


def test_calibrated_values_of_the_robot_survive_a_new_vehicle_file(programs, pi, wheels, vehicle_toml):
    vehicle_toml.write_text(calibrated(SMALL).text)
    file, lines = vehicle_file.override(SMALL, ["robot.port=/dev/serial0"]), []
    setup("r1", wheels, PI, vehicle=file, notify=lines.append, root=str(pi))
    now = vehicle_file.load(vehicle_toml)
    assert now.robot.port == "/dev/serial0"
    assert now.robot.imu_axes == ("-y", "x", "z")
    assert now.sensors.imu.gyro_bias == 0.0123
    assert {now.provenance[key].run for key in CALIBRATION} == {"calibrate imu"}
    assert lines[1:] == [
        'vehicle.toml  robot.imu_axes: ["-y", "x", "z"] is kept, because it was calibrated there on 2026-11-03',
        "vehicle.toml  sensors.imu.gyro_bias: 0.0123 is kept, because it was calibrated there on 2026-11-03",
        "vehicle.toml  To write it into your file too: baqueano robot calibrate imu r1 --update. To use your "
        "own values: ssh r1 rm /var/lib/baqueano/vehicle.toml, and type this line again",
    ]
    text = vehicle_toml.read_text()
    setup("r1", wheels, PI, vehicle=file, root=str(pi))
    assert vehicle_toml.read_text() == text


@pytest.mark.parametrize(
    ("day", "axes"), [(2, ("-y", "x", "z")), (3, ("-y", "x", "z")), (4, ("-x", "-y", "z"))]
)
def test_the_newer_of_two_calibrations_is_used(programs, pi, wheels, vehicle_toml, day, axes):
    vehicle_toml.write_text(calibrated(SMALL).text)
    calibrated_file = calibrated(SMALL, {"robot.imu_axes": ["-x", "-y", "z"]}, date(2026, 11, day))
    setup("r1", wheels, PI, vehicle=calibrated_file, root=str(pi))
    assert vehicle_file.load(vehicle_toml).robot.imu_axes == axes


def test_a_calibration_with_equal_values_retains_its_provenance(programs, pi, wheels, vehicle_toml):
    vehicle_toml.write_text(calibrated(SMALL).text)
    setup("r1", wheels, PI, vehicle=SMALL.with_values(CALIBRATION), root=str(pi))
    assert {vehicle_file.load(vehicle_toml).provenance[key].run for key in CALIBRATION} == {"calibrate imu"}


def test_a_file_without_keys_for_an_existing_calibration_is_refused(programs, pi, wheels, vehicle_toml):
    vehicle_toml.write_text(calibrated(SMALL).text)
    text = SMALL.text.replace("[sensors.imu]", "[sensors.gyro]")
    text = text.replace("[estimator]", '[estimator]\nuse = ["gyro"]')
    with refused("setup.no-place-for-calibration", UsageError, host="r1", value="0.0123"):
        setup("r1", wheels, PI, vehicle=vehicle_file.parse(text, "mine"), root=str(pi))
    assert vehicle_toml.read_text() == calibrated(SMALL).text


@pytest.mark.parametrize(
    ("content", "reason"), [(b"port = \n", "Invalid value (at line 1"), (b"\xff\xfe", "'utf-8' codec")]
)
def test_an_unreadable_vehicle_file_on_the_robot_is_reported_and_backed_up(
    programs, pi, wheels, vehicle_toml, content, reason
):
    vehicle_toml.write_bytes(content)
    lines = []
    setup("r1", wheels, PI, vehicle=SMALL, notify=lines.append, root=str(pi))
    assert lines[0].startswith(f"vehicle.toml  the vehicle file there is not valid TOML ({reason}")
    assert vehicle_toml.read_text() == SMALL.text
    assert vehicle_toml.with_name("vehicle.toml.before").read_bytes() == content
    programs(ssh="echo no way >&2; exit 255")
    with refused("setup.file-not-read", RobotUnreachable, host="r1"):
        setup("r1", wheels, PI, vehicle=SMALL, root=str(pi))


def test_a_vehicle_file_changed_during_setup_is_not_replaced(programs, pi, wheels, vehicle_toml):
    """Another person calibrates the vehicle between the check and the change of the file."""
    (wheels / "vehicle.toml.seen").write_text("# what was looked at\n")
    step = steps.vehicle_step(steps.Pi(pi, wheels, "ana"))
    assert not step.done()
    with pytest.raises(SystemExit, match=r"Another program changed .*, so this command did not change it"):
        step.do()
    assert vehicle_toml.read_text() == SMALL.text


@pytest.mark.parametrize("own", [True, False])
def test_setup_without_a_vehicle_file_does_not_change_the_robots_file(
    programs, pi, wheels, vehicle_toml, monkeypatch, tmp_path, capfd, own
):
    vehicle_toml.write_text("# of the robot\n")
    monkeypatch.chdir(tmp_path)
    if own:
        SMALL.save("vehicle.toml")
    monkeypatch.setattr(install, "make_bundle", lambda *options: wheels)
    monkeypatch.setattr(install, "host_machine", lambda host: PI)
    monkeypatch.setattr(install, "setup", partial(setup, root=str(pi)))
    with pytest.raises(SystemExit) as exit_info:
        main(["robot", "setup", "r1"])
    assert exit_info.value.code == 0
    assert vehicle_toml.read_text() == (SMALL.text if own else "# of the robot\n")
    assert ("does not contain vehicle.toml" in capfd.readouterr().err) != own
