"""`baqueano robot setup` and `remove`: the real steps in a folder that replaces the Pi; its ssh is local."""

import re
import shutil
import subprocess
from importlib.resources import files
from pathlib import Path

import pytest

from baqueano.errors import FileError, RobotUnreachable, UsageError
from baqueano.robot.setup import install, steps
from baqueano.robot.setup.install import TargetMachine, host_machine, make_bundle, remove, setup
from baqueano.robot.setup.steps import Pi, boot_block_step
from tests.codes import refused

PI = TargetMachine((3, 11), "aarch64", "ana")


def tree(root):
    return {
        p.relative_to(root).as_posix(): "link" if p.is_symlink() else p.read_text()
        for p in root.rglob("*")
        if (p.is_file() or p.is_symlink()) and "var/lib" not in p.as_posix()
    }


def test_su2_setup_installs_a_working_program_and_remove_restores_everything(
    programs, pi, wheels, capfd, tmp_path
):
    before = tree(pi)
    setup("r1", wheels, PI, root=str(pi))
    output = capfd.readouterr().out
    assert output.count("done  ") == 11  # the clock is already correct
    program = subprocess.run([pi / "opt/baqueano/bin/baqueano"], capture_output=True, text=True, check=True)
    assert program.stdout == "here I am\n"
    assert (pi / "usr/local/bin/baqueano").is_symlink()
    config = (pi / "boot/firmware/config.txt").read_text()
    assert config.startswith(before["boot/firmware/config.txt"])
    assert "i2c_arm_baudrate=400000" in config
    unit = (pi / "etc/systemd/system/baqueano.service").read_text()
    assert "User=baqueano\nGroup=baqueano\nSupplementaryGroups=dialout i2c gpio\n" in unit
    assert (pi / "var/lib/baqueano/vehicle.toml").read_text() == "# mine\n"
    calls = (tmp_path / "calls").read_text()
    assert (
        [line for line in calls.splitlines() if line.startswith("usermod")]
        == [
            "usermod -aG dialout,gpio,input,baqueano ana"  # the account of the service has only the groups of its unit
        ]
    )
    (useradd,) = [line for line in calls.splitlines() if line.startswith("useradd")]
    assert "--system" in useradd
    assert "--shell /usr/sbin/nologin baqueano" in useradd
    assert f"chown -R baqueano:baqueano {pi}/var/lib/baqueano\nchmod 2775" in calls
    assert "systemctl enable baqueano.service" in calls
    assert not Path(install.TARGET_FOLDER).exists()

    vehicle_toml = pi / "var/lib/baqueano/vehicle.toml"
    vehicle_toml.write_text("# calibrated\n")
    setup("r1", wheels, PI, root=str(pi))
    assert capfd.readouterr().out.count("as it is") == 9  # usermod and chown are recorded without effect
    assert vehicle_toml.read_text() == "# calibrated\n"

    remove("r1", PI, root=str(pi))
    output = capfd.readouterr().out
    assert "runs and vehicle file in /var/lib/baqueano are kept" in output
    assert tree(pi) == before
    calls = (tmp_path / "calls").read_text()
    assert "systemctl disable --now baqueano.service" in calls
    assert [line for line in calls.splitlines() if line.startswith("gpasswd")] == [
        f"gpasswd -d ana {group}" for group in ("dialout", "gpio", "input", "baqueano")
    ]
    assert calls.rindex("gpasswd") < calls.rindex("userdel baqueano")
    assert f"chown -R ana: {pi}/var/lib/baqueano" in calls  # otherwise runs would not belong to a user
    assert vehicle_toml.exists()
    remove("r1", PI, root=str(pi))
    assert "baqueano is not installed here" in capfd.readouterr().out


def test_a_dry_run_prints_every_step_and_changes_nothing(programs, pi, wheels, capfd):
    before = tree(pi)
    setup("r1", wheels, PI, is_dry_run=True, root=str(pi))
    output = capfd.readouterr().out
    assert output.count("would") == 11
    assert "I2C at 400 kHz" in output
    assert tree(pi) == before


def test_an_interrupted_setup_is_reported_and_can_be_undone(programs, pi, wheels, capfd):
    before = tree(pi)
    programs(usermod="echo no such user >&2; exit 6")
    with refused("setup.not-finished", RobotUnreachable, host="r1"):
        setup("r1", wheels, PI, root=str(pi))
    assert "usermod -aG dialout,gpio,input,baqueano ana failed (6): no such user" in capfd.readouterr().err
    remove("r1", PI, root=str(pi))
    assert tree(pi) == before


def test_an_existing_user_with_the_service_name_is_not_changed(programs, pi, wheels, capfd):
    with (pi / "etc/passwd").open("a") as file:
        file.write("baqueano:x:1001:1001::/home/baqueano:/bin/bash\n")
    before = tree(pi)
    for verb in (setup, setup):
        with refused("setup.not-finished", RobotUnreachable):
            verb("r1", wheels, PI, root=str(pi))
        assert "sudo userdel baqueano" in capfd.readouterr().err
    assert tree(pi) == before


def test_groups_added_by_a_later_setup_are_removed_too(programs, pi, wheels, tmp_path):
    group = (pi / "etc/group").read_text()
    (pi / "etc/group").write_text("dialout:x:20:\n")
    setup("r1", wheels, PI, root=str(pi))
    (pi / "etc/group").write_text(group.replace("dialout:x:20:", "dialout:x:20:ana"))
    setup("r1", wheels, PI, root=str(pi))
    remove("r1", PI, root=str(pi))
    calls = (tmp_path / "calls").read_text().splitlines()
    assert [line for line in calls if line.startswith("gpasswd")] == [
        f"gpasswd -d ana {group}" for group in ("dialout", "baqueano", "gpio", "input")
    ]


def test_su2_a_wheel_with_a_wrong_hash_is_not_installed(programs, pi, wheels, capfd):
    setup("r1", wheels, PI, root=str(pi))
    for name in ("baqueano", "pip"):
        (wheel,) = wheels.glob(f"{name}-*.whl")
        data = wheel.read_bytes()
        wheel.write_bytes(data + b"\0")  # this is still a wheel
        with refused("setup.not-finished", RobotUnreachable):
            setup("r1", wheels, PI, root=str(pi))
        errors = capfd.readouterr().err
        assert "hash" in errors.lower() or "differs from the lock file" in errors
        result = subprocess.run([pi / "opt/baqueano/bin/baqueano"], capture_output=True)
        assert result.stdout == b"here I am\n"
        assert [path.name for path in (pi / "opt").iterdir()] == ["baqueano"]
        wheel.write_bytes(data)
    setup("r1", wheels, PI, root=str(pi))
    assert [path.name for path in (pi / "opt").iterdir()] == ["baqueano"]


@pytest.mark.parametrize("path", ["boot/firmware/config.txt", "etc/baqueano/setup.json"])
def test_a_failed_write_leaves_the_old_file(pi, monkeypatch, path):
    store = Pi(pi, pi, "ana", lambda *command: "")
    store.record_state("something", {"before": "kept"})
    before = (pi / path).read_text()

    def fails(file):
        raise OSError(5, "the power is gone")

    monkeypatch.setattr(steps.os, "fsync", fails)
    with pytest.raises(OSError, match="the power is gone"):
        boot_block_step(store).do() if "config" in path else store.record_state("more", True)
    assert (pi / path).read_text() == before


def test_damaged_setup_notes_are_reported_with_a_remedy(programs, pi, wheels, capfd):
    setup("r1", wheels, PI, root=str(pi))
    (pi / "etc/baqueano/setup.json").write_text('{"boot": tr')
    for verb in (lambda: setup("r1", wheels, PI, root=str(pi)), lambda: remove("r1", PI, root=str(pi))):
        with pytest.raises(RobotUnreachable):
            verb()
        assert "setup.json is damaged (Expecting value" in (errors := capfd.readouterr().err)
        assert "sudo mv" in errors
        assert "Traceback" not in errors
    record = pi / "etc/baqueano/setup.json"
    record.rename(record.with_suffix(".json.damaged"))  # as the remedy advises
    setup("r1", wheels, PI, root=str(pi))
    remove("r1", PI, root=str(pi))
    assert not record.exists()


def test_root_programs_run_from_a_new_private_folder(programs, pi, tmp_path):
    folder = Path(install.TARGET_FOLDER)
    folder.mkdir(mode=0o777)
    (folder / "json.py").write_text("# of somebody else, and imported before Python's own\n")
    look = f"ls -A {folder} >{tmp_path}/seen; stat -c %a {folder} >>{tmp_path}/seen"
    programs(sudo=f'{look}; [ "$1" = -n ] && shift; exec "$@"')
    remove("r1", PI, root=str(pi))
    assert (tmp_path / "seen").read_text().split() == ["steps.py", "700"]


@pytest.mark.parametrize(
    ("answer", "kind", "match"),
    [
        ("exit 255", RobotUnreachable, ("setup.no-answer", {"host": "r1"})),
        ("echo 3 11 armv7l pi", UsageError, ("setup.32-bit", {"host": "r1", "computer": "armv7l"})),
        ("echo 3 9 aarch64 pi", UsageError, ("setup.old-python", {"host": "r1", "major": 3, "min_major": 3})),
    ],
)
def test_an_unsuitable_machine_is_refused_with_a_reason(programs, answer, kind, match):
    programs(ssh=answer)
    with refused(match[0], kind, **match[1]):
        host_machine("r1")


def test_the_probe_reports_python_version_and_user_of_the_machine(programs):
    target = host_machine("r1")
    assert target.python >= (3, 11)
    assert target.user


@pytest.mark.parametrize(
    ("verb", "match"), [("setup", ("setup.packages-not-sent", {})), ("remove", ("setup.nothing-sent", {}))]
)
def test_a_failed_transfer_to_the_robot_is_reported(programs, wheels, verb, match):
    programs(ssh="cat >/dev/null; exit 1")
    with refused(match[0], RobotUnreachable, **match[1]):
        setup("r1", wheels, PI) if verb == "setup" else remove("r1", PI)


def test_a_failed_download_of_packages_is_reported_with_its_error(tmp_path, monkeypatch):
    python = tmp_path / "python"
    python.write_text("#!/bin/sh\necho 'ERROR: no network' >&2\nexit 1\n")
    python.chmod(0o755)
    monkeypatch.setattr(install.sys, "executable", str(python))
    with refused("setup.packages", FileError, reply="ERROR: no network"):
        make_bundle(tmp_path / "bundle", PI)


def test_downloaded_packages_are_not_downloaded_again(tmp_path, monkeypatch):
    python, folder = tmp_path / "python", tmp_path / "bundle"
    python.write_text(f'#!/bin/sh\necho "$*" >>{tmp_path}/calls\n')
    python.chmod(0o755)
    folder.mkdir()
    lock = (files("baqueano.robot") / "files" / "onboard.lock").read_text()
    for match in install.LOCKED_PACKAGE.finditer(lock):
        (folder / f"{match[1]}-{match[2]}-py3-none-any.whl").touch()
    monkeypatch.setattr(install.sys, "executable", str(python))
    make_bundle(folder, PI)
    calls = (tmp_path / "calls").read_text()
    assert "wheel --no-deps" in calls
    assert " download --" not in calls
    assert (folder / "steps.py").exists()


def test_the_download_requests_packages_for_the_robots_processor_and_python(tmp_path, monkeypatch):
    python = tmp_path / "python"
    python.write_text(f'#!/bin/sh\necho "$*" >>{tmp_path}/calls\n')
    python.chmod(0o755)
    monkeypatch.setattr(install.sys, "executable", str(python))
    lines = []
    make_bundle(tmp_path / "bundle", PI, lines.append)
    (line,) = [x for x in (tmp_path / "calls").read_text().splitlines() if " download --" in x]
    assert "--python-version 311 --abi cp311" in line
    assert "--platform manylinux_2_28_aarch64" in line
    assert "for Python 3.11 on aarch64" in lines[0]
    assert "--require-hashes -r" in line


def test_su2_the_onboard_lock_contains_all_required_packages_with_hashes():
    lock = (files("baqueano.robot") / "files" / "onboard.lock").read_text()
    names = {match[1] for match in install.LOCKED_PACKAGE.finditer(lock)}
    assert names == set(re.findall(r"^([\w.-]+)==", lock, re.MULTILINE))
    assert {"numpy", "mcap", "click", "smbus2", "pyserial", "tomlkit", "pip"} <= names


def test_setup_on_another_computer_changes_no_boot_file(programs, pi, wheels, capfd):
    (pi / "boot/firmware/config.txt").unlink()
    (pi / "etc/group").write_text("dialout:x:20:ana\n")
    setup("r1", wheels, PI, root=str(pi))
    assert "not a Raspberry Pi" in capfd.readouterr().out
    assert not (pi / "boot/firmware/config.txt").exists()
    assert "SupplementaryGroups=dialout\n" in (pi / "etc/systemd/system/baqueano.service").read_text()
    remove("r1", PI, root=str(pi))
    assert not (pi / "etc/baqueano").exists()


@pytest.mark.skipif(not shutil.which("systemd-analyze"), reason="systemd-analyze is not installed")
def test_systemd_accepts_every_line_of_the_unit(tmp_path):
    text = (files("baqueano.robot") / "files" / "baqueano.service").read_text()
    unit = tmp_path / "baqueano.service"
    unit.write_text(
        text.replace("@user@", "root")
        .replace("@groups@", "root")
        .replace("/opt/baqueano/bin/baqueano", "/bin/sh")
    )
    result = subprocess.run(["systemd-analyze", "verify", unit], capture_output=True, text=True)
    # systemd-analyze returns 0 for unknown keys
    complaints = [line for line in result.stderr.splitlines() if "baqueano.service" in line]
    assert not complaints
    assert result.returncode == 0
