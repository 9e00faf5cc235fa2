"""Define the changes that make a Raspberry Pi a vehicle, step by step, and how to undo each change.

This module uses only the standard library: `baqueano robot setup` sends it, behind machine.py, and the system's
python3 runs it as root.

    python3 steps.py plan|do|undo --bundle FOLDER --user NAME [--root /] [--now SECONDS]

Each step can check if its change is already made, make it, and undo it. The former state is stored in
/etc/baqueano/setup.json. This file is written at each step, so that an interrupted setup can be undone as well. Runs,
the vehicle file and the previous one, vehicle.toml.before, are in /var/lib/baqueano. They belong to the user and are
not removed.
"""

import argparse
import hashlib
import os
import shutil
import sys
import time
import zlib
from collections.abc import Callable
from pathlib import Path

from baqueano.robot.setup.machine import ACCOUNT, Pi, Step, _, read_text, replace_entry, write_atomically

DEVICES = ("dialout", "i2c", "gpio")  # groups of the devices that the service opens
GROUPS = (*DEVICES, "input")  # "input": a game pad, for a user at the vehicle
NO_LOGIN_SHELLS = ("nologin", "false")  # shells of accounts that cannot log in
BEGIN, END = "# baqueano: begin", "# baqueano: end"
CONFIG_BLOCK = f"""{BEGIN}
[all]
dtparam=i2c_arm=on,i2c_arm_baudrate=400000
# the I2C clock follows the core's: it must not step
[pi3]
core_freq=250
[pi02]
core_freq=250
[all]
{END}
"""
HOME = "var/lib/baqueano"
MAX_CLOCK_ERROR_S = 60.0


def steps(pi: Pi, now_s: float | None = None) -> list[Step]:
    """Return all steps of a setup, in the order in which they are made."""
    unit = read_text(pi.bundle / "baqueano.service")
    unit = unit.replace("@user@", ACCOUNT).replace("@groups@", " ".join(pi.group_members(*DEVICES)))
    rules = read_text(pi.bundle / "60-baqueano.rules")
    return [
        clock_step(pi, now_s),
        boot_block_step(pi),
        file_step(pi, "etc/modules-load.d/baqueano.conf", "i2c-dev\n"),
        file_step(pi, "etc/udev/rules.d/60-baqueano.rules", rules),
        account_step(pi),
        groups_step(pi),
        environment_step(pi),
        link_step(pi, "usr/local/bin/baqueano", "/opt/baqueano/bin/baqueano"),
        vehicle_step(pi),
        home_step(pi),
        file_step(pi, "etc/systemd/system/baqueano.service", unit),
        service_step(pi),
    ]


def clock_step(pi: Pi, now_s: float | None) -> Step:
    """Return the step that sets a Pi's clock to the laptop's time `now_s` [s]; a Pi without a network has a wrong time.
    If `now_s` is None, the clock is not changed.
    """
    return Step(
        _("clock: the laptop's time") if now_s is not None else _("clock: unchanged"),
        lambda: now_s is None or abs(time.time() - now_s) < MAX_CLOCK_ERROR_S,
        lambda: pi.run("date", "-s", f"@{now_s:.0f}"),
    )


def boot_block_step(pi: Pi) -> Step:
    """Return the step that sets, in config.txt, I2C to 400 kHz and a fixed core clock."""

    def text_without_block() -> str:
        text = pi.config.read_text(encoding="utf-8")
        head, begin, rest = text.partition(BEGIN)
        return head + rest.partition(END + "\n")[2] if begin else text

    def do() -> None:
        pi.record_state("boot", value=True)
        text = text_without_block()
        write_atomically(pi.config, text + ("" if not text or text.endswith("\n") else "\n") + CONFIG_BLOCK)

    def undo() -> None:
        write_atomically(pi.config, text_without_block())

    if not pi.config.exists():
        return Step(_("config.txt is missing: this is not a Raspberry Pi"), lambda: True)
    name = _("{path}: I2C at 400 kHz, core_freq fixed (after the next start)", path=pi.config)
    return Step(name, lambda: CONFIG_BLOCK in pi.config.read_text(encoding="utf-8"), do, "boot", undo)


def file_step(pi: Pi, path: str, text: str) -> Step:
    """Return the step that writes a whole file; its `undo` restores the former file."""
    target, key = pi.target_path(path), f"file {path}"

    def do() -> None:
        pi.record_state(key, {"before": target.read_text(encoding="utf-8") if target.exists() else None})
        target.parent.mkdir(parents=True, exist_ok=True)
        write_atomically(target, text)

    def undo() -> None:
        former_text = pi.stored_state[key]["before"]
        if former_text is None:
            target.unlink(missing_ok=True)
        else:
            write_atomically(target, former_text)

    is_done = lambda: target.exists() and target.read_text(encoding="utf-8") == text  # noqa: E731
    return Step(f"/{path}", is_done, do, key, undo)


def link_step(pi: Pi, path: str, to: str) -> Step:
    """Return the step that makes the link `path` to the command `to`, for all users."""
    link, key = pi.target_path(path), f"link {path}"

    def do() -> None:
        pi.record_state(key, {"before": os.readlink(link) if link.is_symlink() else None})
        link.parent.mkdir(parents=True, exist_ok=True)
        link.unlink(missing_ok=True)
        link.symlink_to(to)

    def undo() -> None:
        link.unlink(missing_ok=True)
        if pi.stored_state[key]["before"] is not None:
            link.symlink_to(pi.stored_state[key]["before"])

    return Step(f"/{path} → {to}", lambda: link.is_symlink() and os.readlink(link) == to, do, key, undo)


def account_step(pi: Pi) -> Step:
    """Return the step that creates the account of the service, which cannot log in.

    Raise SystemExit if that name belongs to a user who can log in.
    """
    if (entry := pi.account_fields()) is not None and Path(entry[6]).name not in NO_LOGIN_SHELLS:
        sys.exit(
            _(
                "On this vehicle {user} is the account of a person, but the service needs that name. Log "
                "in as another user, and type: sudo userdel {user}",
                user=ACCOUNT,
            )
        )

    def do() -> None:
        pi.record_state("account", value=True)
        shell, home = "/usr/sbin/nologin", f"/{HOME}"
        words = ("--system", "--user-group", "--no-create-home", "--home-dir", home, "--shell", shell)
        pi.run("useradd", *words, ACCOUNT)

    def undo() -> None:
        if pi.account_fields() is not None:
            pi.run("userdel", ACCOUNT)

    name = _("{user}: the account of the service, without a login", user=ACCOUNT)
    return Step(name, lambda: pi.account_fields() is not None, do, "account", undo)


def groups_step(pi: Pi) -> Step:
    """Return the step that adds the user to the groups for the serial line, the bus, a game pad and the service."""

    def missing() -> list[str]:
        members_by_group = {**pi.group_members(*GROUPS), ACCOUNT: pi.group_members(ACCOUNT).get(ACCOUNT, [])}
        return [group for group, members in members_by_group.items() if pi.user not in members]

    def do() -> None:
        pi.record_state("groups", missing())
        pi.run("usermod", "-aG", ",".join(missing()), pi.user)

    def undo() -> None:
        for group in pi.stored_state["groups"]:
            pi.run("gpasswd", "-d", pi.user, group)

    return Step(
        _("{user} is in {groups}", user=pi.user, groups=", ".join([*pi.group_members(*GROUPS), ACCOUNT])),
        lambda: not missing(),
        do,
        "groups",
        undo,
    )


def environment_step(pi: Pi) -> Step:
    """Return the step that makes the venv of the service from the wheels of the bundle, without internet access.

    The step uses pip from the bundle. The old venv stays until the new one is complete, and is restored if
    the installation fails.
    """
    wheels = [f"{path.name} {zlib.crc32(path.read_bytes()):08x}" for path in sorted(pi.bundle.glob("*.whl"))]
    stamp, former_venv = pi.venv / "bundle.txt", pi.venv.with_name("baqueano.before")

    def do() -> None:
        pi.record_state("environment", value=True)
        if stamp.exists():  # the present venv is complete
            shutil.rmtree(former_venv, ignore_errors=True)
            os.rename(pi.venv, former_venv)
        try:
            install()
        except BaseException:
            shutil.rmtree(pi.venv, ignore_errors=True)
            if former_venv.exists():
                os.rename(former_venv, pi.venv)
            raise
        shutil.rmtree(former_venv, ignore_errors=True)

    def install() -> None:
        shutil.rmtree(pi.venv, ignore_errors=True)
        pi.venv.parent.mkdir(parents=True, exist_ok=True)
        python = sys.executable if sys.prefix == sys.base_prefix else "python3"
        pi.run(python, "-m", "venv", "--without-pip", str(pi.venv))
        locks = {
            name: (pi.bundle / f"{name}.lock").read_text(encoding="utf-8") for name in ("pip", "packages")
        }
        pips = [(path, hashlib.sha256(path.read_bytes()).hexdigest()) for path in pi.bundle.glob("pip-*.whl")]
        pip = next((path for path, digest in pips if f"sha256:{digest}" in locks["pip"]), None)
        if pip is None:
            sys.exit(_("The package of pip differs from the lock file, so nothing was installed"))
        words = (
            "install",
            "--quiet",
            "--no-index",
            "--no-deps",
            "--no-warn-script-location",
            "--require-hashes",
        )
        packages = ("--find-links", str(pi.bundle), "-r", str(pi.bundle / "packages.lock"))
        pi.run(str(pi.venv / "bin/python"), str(pip / "pip"), *words, *packages)
        write_atomically(stamp, "\n".join(wheels))

    def undo() -> None:
        shutil.rmtree(pi.venv, ignore_errors=True)
        shutil.rmtree(former_venv, ignore_errors=True)

    is_installed = lambda: stamp.exists() and stamp.read_text(encoding="utf-8") == "\n".join(wheels)  # noqa: E731
    name = _("/opt/baqueano: a venv with {wheels} packages", wheels=len(wheels))
    return Step(name, is_installed, do, "environment", undo)


def vehicle_step(pi: Pi) -> Step:
    """Return the step that installs the vehicle file. The old file is kept as vehicle.toml.before.

    An existing file is replaced only if it still equals vehicle.toml.seen of the bundle, the file from which the new
    one was made. If another program has changed it since then, raise SystemExit. An empty file, as a power cut can
    leave, counts as absent. The folder belongs to the service, whose blocks could put links into it.
    """
    target, bundle_file = pi.target_path(f"{HOME}/vehicle.toml"), pi.bundle / "vehicle.toml"
    former_file, base = target.with_name("vehicle.toml.before"), pi.bundle / "vehicle.toml.seen"

    def content(path: Path) -> bytes:
        return path.read_bytes() if path.exists() else b""

    def is_done() -> bool:
        if not bundle_file.exists() or (content(target) and not base.exists()):
            return True
        return content(target) == content(bundle_file)

    def do() -> None:
        target.parent.mkdir(parents=True, exist_ok=True)
        if old_content := content(target):
            if old_content != content(base):
                sys.exit(
                    _(
                        "Another program changed {path}, so this command did not change it: type the line "
                        "again",
                        path=target,
                    )
                )
            replace_entry(former_file, old_content)
        replace_entry(target, content(bundle_file))

    old = _("; the previous file is vehicle.toml.before") if content(target) and not is_done() else ""
    return Step(f"/var/lib/baqueano/vehicle.toml{old}", is_done, do)


def home_step(pi: Pi) -> Step:
    """Return the step that gives runs and vehicle file to the service's account; its group can change both."""
    place = pi.target_path(HOME)

    def is_done() -> bool:
        entry = pi.account_fields()
        return entry is not None and place.exists() and place.stat().st_uid == int(entry[2])

    def do() -> None:
        pi.record_state("home", value=True)
        place.mkdir(parents=True, exist_ok=True)
        pi.run("chown", "-R", f"{ACCOUNT}:{ACCOUNT}", str(place))
        pi.run("chmod", "2775", str(place))

    def undo() -> None:
        pi.run("chown", "-R", f"{pi.user}:", str(place))

    return Step(_("/{path}: it belongs to {user}", path=HOME, user=ACCOUNT), is_done, do, "home", undo)


def service_step(pi: Pi) -> Step:
    """Return the step that starts the service now, and whenever the machine starts."""

    def do() -> None:
        pi.record_state("service", value=True)
        pi.run("udevadm", "control", "--reload")
        pi.run("systemctl", "daemon-reload")
        pi.run("systemctl", "enable", "baqueano.service")
        pi.run("systemctl", "restart", "--no-block", "baqueano.service")

    def undo() -> None:
        pi.run("systemctl", "disable", "--now", "baqueano.service")

    return Step(_("baqueano.service: enabled and started"), lambda: False, do, "service", undo)


def undo(pi: Pi, selected_steps: list[Step]) -> int:
    """Undo the recorded changes, the last change first; return the exit code."""
    if not pi.stored_state:
        print(_("baqueano is not installed here"))
        return 0
    for step in reversed(selected_steps):
        if step.key in pi.stored_state:
            step.undo()
            pi.record_state(step.key, None)
            print(_("undone   {step}", step=step.name))
    pi.run("systemctl", "daemon-reload")
    pi.run("udevadm", "control", "--reload")
    print(
        _("runs and vehicle file in /var/lib/baqueano are kept; config.txt takes effect after the next start")
    )
    return 0


def main(arguments: list[str] | None = None, run: Callable[..., str] | None = None) -> int:
    """Plan, do or undo the steps, print one line for each, and return the exit code."""
    parser = argparse.ArgumentParser()
    parser.add_argument("what", choices=("plan", "do", "undo"))
    parser.add_argument("--bundle", type=Path, default=Path())
    parser.add_argument("--user", required=True)
    parser.add_argument("--root", type=Path, default=Path("/"))
    parser.add_argument("--now", type=float)
    options = parser.parse_args(arguments)
    pi = Pi(options.root, options.bundle, options.user, run)
    selected_steps = steps(pi, options.now)
    if options.what == "undo":
        return undo(pi, selected_steps)
    for step in selected_steps:
        if step.done():
            print(_("as it is {step}", step=step.name))
        elif options.what == "plan":
            print(_("would    {step}", step=step.name))
        else:
            step.do()
            print(_("done     {step}", step=step.name))
    return 0


if __name__ == "__main__":
    sys.exit(main())
